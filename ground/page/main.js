// Puts the parts together: what the station says goes to each of them, what the person does goes to the station.
import { Connection, takeToken } from './connection.js';
import { DelayPlot } from './delay.js';
import { Draft } from './draft.js';
import { cleaned, Fleet, FLYING, put, STALE_MS } from './drones.js';
import { Events } from './events.js';
import { Faults } from './faults/panel.js';
import { libraries } from './lib/built.js';
import { Blocks } from './look/blocks.js';
import { SpaceSwitch } from './look/space.js';
import { bindKeys, flyByKeys, Hand } from './keys.js';
import { PlanView } from './map.js';
import { Missions } from './missions/panel.js';
import { isOurs, isStopped, named, nameOf, whyNotMine } from './operators/rules.js';
import { closeDialogs, Operators } from './operators/session.js';
import { flyByGamepad, flyByTouch } from './pads.js';
import { StopAll } from './stop.js';

const NEWS_MS = 5000; // an older event is history

const at = (id) => document.getElementById(id);

/// The style sheet's colours, for canvases; they change with the theme.
function inks() {
  const probe = at('ink');
  let known = new Map();
  const forget = () => (known = new Map());
  matchMedia('(prefers-color-scheme: dark)').addEventListener('change', forget);
  const ink = (name) => {
    if (!known.has(name)) {
      probe.style.color = `var(--${name})`;
      known.set(name, getComputedStyle(probe).color);
    }
    return known.get(name);
  };
  return { ink, forget };
}

/// As the system has it, light, dark.
function themeSwitch(changed) {
  const themes = ['auto', 'light', 'dark'];
  const show = (theme) => {
    document.documentElement.dataset.theme = theme;
    at('theme').textContent = `Theme: ${theme}`;
    changed();
  };
  let theme = localStorage.getItem('theme');
  if (!themes.includes(theme)) theme = 'auto';
  show(theme);
  at('theme').addEventListener('click', () => {
    theme = themes[(themes.indexOf(theme) + 1) % themes.length];
    localStorage.setItem('theme', theme);
    show(theme);
  });
}

const { ink, forget } = inks();
themeSwitch(forget);
const connection = new Connection();
const operators = new Operators(connection, () => fleet.drones.filter((drone) => isOurs(drone, operators)).map((drone) => drone.name));
const fleet = new Fleet(connection, operators);
const map = new PlanView(at('map'), ink);
const delay = new DelayPlot(at('delay'), ink, libraries);
const events = new Events((text) => named(text, operators));
const blocks = new Blocks();
const stopAll = new StopAll(connection, (identity) => nameOf(identity, operators));
const draft = new Draft(map, at('map'), connection, () => fleet.drone);
const missions = new Missions(connection, operators, map);
const faults = new Faults(connection, operators);
draft.onkeep = (path) => missions.keep(path);
missions.onmade = () => draft.on && draft.toggle(false);
const space = new SpaceSwitch(map, draft, ink, libraries);

let keysOn = true;
let linkWords = 'Not connected';
let delayMs = null;
let blockAt = 0; // when the newest block came, or the connection
const SILENT_LEDGER_MS = 2000; // drones' states alone make many blocks a second; of the channel of [ledger]
let stationMs = () => 0; // the station's clock

const inManual = () => connection.hello.manual && fleet.drone?.phase === 'manual';
const mayFly = () => connection.up && inManual() && !stopAll.pending && whyNotMine(fleet.drone, operators) === null;
const hand = new Hand(
  (drone, linear, yaw_rate) => connection.send({ op: 'velocity', drone, linear, yaw_rate, t_ms: connection.stateMs }),
  () => (mayFly() ? fleet.selected : null),
);
flyByKeys(hand, () => keysOn && mayFly());
flyByGamepad(hand, at('gamepad-words'));
flyByTouch(hand, [at('pad-left'), at('pad-right')]);
const showPads = () => document.body.classList.add('touch');
if (matchMedia('(pointer: coarse)').matches) showPads();
addEventListener('pointerdown', (event) => event.pointerType === 'touch' && showPads()); // a screen beside a mouse
hand.onchange = (flown) => at('fly').classList.toggle('flying', flown !== null);

stopAll.onstop = () => {
  hand.release();
  closeDialogs();
};
for (const button of document.querySelectorAll('.stop-here')) button.addEventListener('click', () => stopAll.stop(fleet.drones)); // a dialog covers the other
fleet.onselect = (name) => {
  hand.release();
  map.selected = name;
  if (draft.on) draft.reselect();
};
map.onpick = (name) => fleet.select(name);

bindKeys({
  Backspace: () => (stopAll.stop(fleet.drones), true),
  Escape: () => draft.clear(),
  Enter: (event) => !event.target.closest?.('button, a, summary') && draft.fly(),
  v: () => (space.toggle(), true),
  m: () => (missions.toggle(), true),
  f: () => faults.toggle(),
  digit: (event) => keysOn && fleet.drones[Number(event.key) - 1] && (fleet.select(fleet.drones[Number(event.key) - 1].name), true),
});
at('keys-on').addEventListener('click', () => {
  keysOn = !keysOn;
  hand.release();
  at('keys-on').setAttribute('aria-pressed', keysOn);
});
at('zoom-in').addEventListener('click', () => space.seen.zoom(0.8));
at('zoom-out').addEventListener('click', () => space.seen.zoom(1.25));
at('zoom-fit').addEventListener('click', () => space.seen.fit());
at('blocks-on').addEventListener('click', () => {
  const on = at('blocks-log').hidden;
  at('blocks-log').hidden = !on;
  at('events-log').hidden = on;
  at('blocks-on').setAttribute('aria-pressed', on);
});

connection.addEventListener('hello', async ({ detail: hello }) => {
  put(at('link-back'), hello.back ?? '');
  blockAt = performance.now();
  blocks.restart();
  hand.speed_mps = connection.hello.speed_mps;
  await operators.load();
  missions.refresh();
  const answer = await connection.request('GET', 'events?since=0');
  events.restart(hello.started_ms);
  if (answer.ok) events.add(answer.body.events);
  if (hello.back) events.note(hello.back);
});
function takeState(said, now) {
  const drones = said.map(cleaned);
  fleet.update(drones, now);
  map.update(drones, now);
  map.fence = drones.some((drone) => drone.position) ? connection.hello.fence : null; // without a pose there is no map
  at('fence-help').hidden = map.fence === null;
  stopAll.update(drones);
}
connection.addEventListener('state', ({ detail }) => {
  const now = performance.now();
  delayMs = detail.delay_ms ?? null;
  stationMs = () => detail.t_ms + performance.now() - now;
  events.setClock(Date.now() - detail.t_ms);
  blocks.setClock(Date.now() - detail.t_ms);
  takeState(detail.drones, now);
  delay.add(now, delayMs, Math.max(0, ...fleet.drones.filter((drone) => drone.has_state).map((drone) => drone.state_age_ms)), fleet.drones);
});
connection.addEventListener('blocks', ({ detail }) => {
  blockAt = performance.now();
  blocks.add(detail.blocks);
});
connection.addEventListener('events', ({ detail }) => {
  events.add(detail.events);
  fleet.hear(detail.events.filter((event) => connection.stateMs - event.t_ms < NEWS_MS));
});
connection.addEventListener('missions', ({ detail }) => missions.update(detail.missions));
connection.addEventListener('faults', ({ detail }) => faults.update(detail.faults, detail.why));
connection.addEventListener('session', () => {
  hand.release();
  missions.refresh();
});
connection.addEventListener('link', ({ detail }) => {
  linkWords = detail.words;
  if (detail.up) at('token').hidden = true;
  else hand.release();
});
connection.addEventListener('token', ({ detail }) => {
  at('token').hidden = false;
  put(at('token-words'), detail);
  at('token-field').focus();
});
at('token').addEventListener('submit', (event) => {
  event.preventDefault();
  connection.start(at('token-field').value.trim());
  at('token-field').value = '';
});
addEventListener('online', () => connection.retryNow());

function showLink(now) {
  const silent = fleet.silent(now);
  const quiet = connection.up && fleet.drones.length > 0 && silent > STALE_MS;
  const ledgerSilent = connection.up && !quiet && now - blockAt > SILENT_LEDGER_MS;
  const aloft = fleet.drones.some((drone) => FLYING.includes(drone.phase)); // on the ground there may be nothing to say
  at('link').dataset.level = !connection.up ? 'stale' : quiet || (ledgerSilent && aloft) ? 'late' : 'fresh';
  put(at('link-words'), quiet ? 'Connected, but nothing comes' : ledgerSilent ? `Connected; the ledger has sent no block for ${Math.floor((now - blockAt) / 1000)} s` : linkWords);
  put(at('link-age'), connection.up && !quiet && delayMs !== null ? `${Math.round(delayMs)} ms` : fleet.drones.length ? `data ${(silent / 1000).toFixed(1)} s old` : '');
}

function showFlying() {
  const drone = fleet.drone;
  // Without operators the station takes the lease when it takes off.
  const others = drone && (operators.operators.length || inManual()) ? whyNotMine(drone, operators) : null;
  const words = !connection.up ? 'Not connected: keys and pads do nothing.'
    : !connection.hello.manual ? 'This flight is not flown by hand: keys and pads do nothing.'
      : !drone ? 'No drone is selected.'
        : stopAll.pending ? 'Stopping: keys and pads do nothing.'
          : others ?? (!inManual() ? `${drone.name} cannot be flown by hand now: ${drone.phase === 'path' ? 'it is on its path' : FLYING.includes(drone.phase) ? 'wait' : isStopped(drone) ? 'it is stopped: clear the stop first' : 'take off first'}.`
            : hand.flown ? `Flying ${drone.name}. Let go to hover.` : `Hold a key${document.body.classList.contains('touch') ? ' or a pad' : ''} to fly ${drone.name} at ${hand.speed_mps} m/s. Let go to hover.`);
  put(at('fly-words'), words);
  put(at('keys-on'), keysOn ? 'Keys: on' : 'Keys: off');
}

function frame(now) {
  space.draw(now, (drone) => fleet.age(drone, now));
  delay.follow(now);
  requestAnimationFrame(frame);
}
requestAnimationFrame(frame);
setInterval(() => {
  const now = performance.now();
  connection.check(now);
  fleet.show(connection.up, now);
  showLink(now);
  showFlying();
}, 100);
setInterval(async () => {
  const now = performance.now();
  if (fleet.drones.length && (!connection.up || fleet.silent(now) > STALE_MS)) delay.add(now, null, fleet.silent(now));
  delay.say(now);
  delay.draw(now);
  blocks.draw(stationMs());
  if (!stopAll.pending || fleet.silent(now) < STALE_MS) return;
  const answer = await connection.request('GET', 'drones'); // the stop is followed without the stream, too
  if (answer.ok) takeState(connection.withPaths(answer.body.drones), performance.now());
}, 500);

connection.start(takeToken());
addEventListener('hashchange', () => location.reload()); // a new flight's address, entered where the page is open
