// Who may do what with a drone, in words. With operators a drone obeys its lease's holder alone; without, anyone who
// knows the page's token.

/// "Org2MSP CN=User1@org2.ledgerline,OU=client": "User1@org2.ledgerline (Org2MSP)".
export function shortName(identity) {
  const found = /^(\S+) .*?CN=([^,]+)/.exec(identity);
  return found ? `${found[2]} (${found[1]})` : identity;
}

/// `who`: {operators: [{name, identity}], operator, identity}: who may sign in, and who is signed in (null: nobody).
export const nameOf = (identity, who) => who.operators.find((each) => each.identity === identity)?.name ?? shortName(identity);

/// A text of the station with operators' names in place of their identities; one that only begins as an operator's stays.
export function named(text, who) {
  return who.operators.reduce((said, { name, identity }) => said.split(identity).reduce((before, after) => `${before}${/^($|[\s;)]|, )/.test(after) ? name : identity}${after}`), text);
}

/// What an event says of a request for its drone, to be shown on its card; null: nothing.
export function replyOf({ text, level }, who) {
  if (who.operator && text.startsWith(`${who.operator}: `)) return `${text}${level === 'info' ? ': done' : ''}`;
  return /^no [a-z-]+: /.test(text) ? named(text, who) : null; // "no take-off: ..."
}

export const SIGN_IN = 'Sign in first: commands are signed by the operator.';
const hasOperators = (who) => who.operators.length > 0;
const isHeld = (drone) => Boolean(drone.lease?.holder);
const isMine = (drone, who) => who.identity !== null && drone.lease?.holder === who.identity;
export const isStopped = (drone) => drone.stopped_by?.length > 0;
export const identityOf = ({ msp, subject }) => `${msp} ${subject}`;
const hasAsked = (drone, who) => (drone.requests ?? []).some((each) => identityOf(each) === who.identity);

/// Why keys, paths and take-offs of this person are not for this drone; null: they are.
export function whyNotMine(drone, who) {
  if (hasOperators(who) && !who.identity) return SIGN_IN;
  if (!isHeld(drone)) return `${drone.name} is held by nobody${hasOperators(who) ? ': take control first' : ''}.`;
  if (hasOperators(who) && !isMine(drone, who)) return `${drone.name} is held by ${nameOf(drone.lease.holder, who)}: ask for it.`;
  if (drone.lease.ours) return null;
  return hasOperators(who) ? `${drone.name} is yours, but commanded from elsewhere: take control here.` : `${drone.name} is held by ${nameOf(drone.lease.holder, who)}.`;
}

/// What the ledger knows of who holds it.
export function leaseWords(drone, who) {
  const { lease } = drone;
  if (!isHeld(drone)) return 'nobody holds it';
  const name = nameOf(lease.holder, who);
  if (!hasOperators(who)) return lease.ours ? `ours${isStopped(drone) ? ', no commands while stopped' : ''}: ${name}` : `NOT ours: ${name}`;
  const held = isMine(drone, who) ? `yours (${name})` : `held by ${name}`;
  return lease.ours ? held : `${held}, commanded by ${nameOf(lease.commander ?? lease.holder, who)}`;
}

export const isOurs = (drone, who) => (hasOperators(who) ? isMine(drone, who) : drone.lease?.ours === true);

/// What an operator signs for a drone: [the button, whether it is shown, why it cannot be asked now (null: it can)]. Other
/// buttons' reasons are in drones.js and missions/words.js; the station's own in lease_problem() of ground/service/core/api.cpp.
export const CONTROLS = {
  acquire: ['Take control', (drone, who) => !isHeld(drone) || (isMine(drone, who) && !drone.lease.ours), () => null],
  release: ['Give back', isMine, () => null],
  request: ['Ask for it', (drone, who) => isHeld(drone) && !isMine(drone, who), (drone, who) => (hasAsked(drone, who) ? `${drone.name} is asked for already: its holder answers.` : null)],
  clear_stop: ['Clear stop', isStopped, (drone, _who, flying) => (flying ? `${drone.name} is still landing.` : null)],
};

/// Without operators a page's token clears what the station itself has stopped; all else is `ledgerline control`'s.
export const isShown = (what, drone, who) => (hasOperators(who) ? CONTROLS[what][1](drone, who) : what === 'clear_stop' && isStopped(drone));
export const maySign = (who) => !hasOperators(who) || who.identity !== null;
export const whyNotControl = (what, drone, who, flying) => (maySign(who) ? CONTROLS[what][2](drone, who, flying) : SIGN_IN);
