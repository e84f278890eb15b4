// The two other hands: a gamepad whose shoulder button is the deadman, and two pads for fingers.

const DEAD_ZONE = 0.12;
const SHOULDERS = [4, 5]; // of the standard mapping
const beyond = (value) => (Math.abs(value) < DEAD_ZONE ? 0 : value);

/// Sticks as a pilot knows them: left is height and heading, right is forward and sideways.
const sharesOf = (left, right) => [-right.y, -right.x, -left.y, -left.x];

/// Read at each frame of the screen; says in words what is there.
export function flyByGamepad(hand, words) {
  let held = false;
  let needsRelease = false;
  hand.addEventListener('release', () => {
    needsRelease = true;
    held = false;
  });
  const read = () => {
    const all = document.hidden || !document.hasFocus() ? [] : [...navigator.getGamepads()].filter(Boolean);
    const pad = all.find((each) => each.mapping === 'standard');
    const pressed = Boolean(pad && SHOULDERS.some((button) => pad.buttons[button]?.pressed));
    if (!pad) needsRelease = true; // a button held through a change of window does not fly at once
    else if (!pressed) needsRelease = false;
    const flies = pressed && !needsRelease;
    if (flies) {
      const [lx, ly, rx, ry] = pad.axes.map(beyond);
      hand.hold('gamepad', sharesOf({ x: lx, y: ly }, { x: rx, y: ry }));
    } else if (held) hand.hold('gamepad', null);
    held = flies;
    // Firefox on Linux, and radios as joysticks: nobody knows which axis is which.
    const unknown = all.length ? 'This gamepad has no standard layout in this browser: it flies nothing. Try Chromium' : '';
    const said = !pad ? unknown : held ? 'Gamepad: flying' : 'Gamepad: hold a shoulder button to fly';
    if (words.textContent !== said) words.textContent = said;
    requestAnimationFrame(read);
  };
  addEventListener('gamepadconnected', read, { once: true });
}

/// `pads`: the two elements, left and right; a finger on one of them is its deadman.
export function flyByTouch(hand, pads) {
  const at = [null, null];
  const tell = () => {
    const still = { x: 0, y: 0 };
    hand.hold('touch', at.some(Boolean) ? sharesOf(at[0] ?? still, at[1] ?? still) : null);
  };
  pads.forEach((pad, side) => {
    const knob = pad.querySelector('.knob');
    const set = (share) => {
      at[side] = share;
      knob.style.transform = share ? `translate(${share.x * 2.6}rem, ${share.y * 2.6}rem)` : '';
      pad.classList.toggle('held', Boolean(share));
      tell();
    };
    const move = (event) => {
      const box = pad.getBoundingClientRect();
      const share = (value, from, size) => Math.max(-1, Math.min(1, ((value - from) / size) * 2.4 - 1.2));
      set({ x: beyond(share(event.clientX, box.left, box.width)), y: beyond(share(event.clientY, box.top, box.height)) });
    };
    pad.addEventListener('pointerdown', (event) => {
      pad.setPointerCapture(event.pointerId);
      move(event);
    });
    pad.addEventListener('pointermove', (event) => at[side] && pad.hasPointerCapture(event.pointerId) && move(event));
    for (const end of ['pointerup', 'pointercancel', 'lostpointercapture']) pad.addEventListener(end, () => at[side] && set(null));
    hand.addEventListener('release', () => at[side] && set(null));
  });
}
