// What a mission says of itself, and what may be asked of it now, in words.
import { nameOf, SIGN_IN } from '../operators/rules.js';

export const MAX_FILE_BYTES = 4 << 20;
const PHASES = { checked: 'Checked', approved: 'Approved', taking_off: 'Taking off', to_start: 'To its start', flying: 'Flying', done: 'Done', aborted: 'Aborted' };
const FLOWN = ['taking_off', 'to_start', 'flying'];

export const isFlown = (mission) => FLOWN.includes(mission.phase);
export const isOver = (mission) => mission.phase === 'done' || mission.phase === 'aborted';
export function phaseWords(mission) {
  if (mission.phase === 'checked' && isForbidden(mission)) return 'May not start';
  return mission.paused ? 'Paused' : PHASES[mission.phase] ?? mission.phase;
}

export function approvalWords({ approvals, approvals_needed }, who) {
  return `${approvals.length} of ${approvals_needed} approved${approvals.length ? `: ${approvals.map((each) => nameOf(each, who)).join(', ')}` : ''}`;
}

/// "tello1, 3 reached; tello2"
export const droneWords = ({ drones, reached }) => drones.map((drone) => (reached?.[drone] ? `${drone}, ${reached[drone]} reached` : drone)).join('; ');

/// [sign and word, so not by colour alone; where and what]
export const findingWords = ({ words, forbids }) => [forbids ? '■ Forbids the start' : '▲ Warning', words];

/// They come from the last check; a start checks again.
export const isForbidden = ({ findings }) => findings.some((each) => each.forbids);

const enough = ({ approvals, approvals_needed }) => approvals.length >= approvals_needed;

/// [the button, why it cannot be asked now (null: it can)]. Other buttons' reasons are in ../drones.js and ../operators/rules.js.
export const ACTIONS = {
  approve: ['Approve', (mission, who) => {
    if (isFlown(mission) || isOver(mission)) return 'it is flown already';
    if (who.identity && mission.approvals.includes(who.identity)) return 'you have approved it';
    if (mission.phase === 'checked' && isForbidden(mission)) return 'its check forbids the start: repair what is found, remove it and add it again';
    return enough(mission) ? 'it has its approvals' : null;
  }],
  withdraw: ['Withdraw', (mission, who) => {
    if (isFlown(mission) || isOver(mission)) return 'it is flown already';
    return who.identity && !mission.approvals.includes(who.identity) ? 'you have not approved it' : null;
  }],
  start: ['Start', (mission) => {
    if (isFlown(mission)) return 'it is flown already';
    if (isOver(mission)) return 'it has been flown: remove it, then add it again';
    return enough(mission) ? null : 'it lacks approvals';
  }],
  pause: ['Pause', (mission) => (isFlown(mission) ? null : 'it is not flown')],
  land: ['Land', (mission) => (isFlown(mission) ? null : 'it is not flown')],
  remove: ['Remove', (mission) => (isFlown(mission) ? 'it is flown: land it first' : null)],
};

/// Where operators sign in, all but the landing is theirs; and all but that and approving is its owner's alone.
export function whyNot(what, mission, who) {
  if (who.operators.length && !who.identity && what !== 'land') return SIGN_IN;
  const isOwners = !['land', 'approve', 'withdraw'].includes(what);
  if (who.operators.length && isOwners && mission.by && mission.by !== who.identity) return `it is ${nameOf(mission.by, who)}'s`;
  return ACTIONS[what][1](mission, who);
}

/// The content type of a file of a mission; null: it is none.
export function typeOf({ name, type }) {
  if (/\.csv$/i.test(name) || type === 'text/csv') return 'text/csv';
  return /\.json$/i.test(name) || type === 'application/json' ? 'application/json' : null;
}

/// A mission's name from a file's: "Survey 2.csv": "Survey_2".
export const nameOfFile = (file) => file.replace(/\.[^.]*$/, '').replace(/[^A-Za-z0-9_-]+/g, '_').slice(0, 64) || 'mission';

/// As it is sent. `kept`: [{drone, waypoints, then}]; `starts`: {tello1: [x, y, z]}, or null: wherever they stand.
export function missionOf(name, kept, starts) {
  const start = ([x, y]) => ({ x: Math.round(x * 100) / 100, y: Math.round(y * 100) / 100 });
  const drones = kept.map(({ drone, waypoints, then }) => ({ drone, ...(starts && { start: start(starts[drone]) }), waypoints, then }));
  return { name, drones };
}
