// Who is signed in, and the dialog to sign in; where the station has no operators, nothing of it is seen.

const at = (id) => document.getElementById(id);

/// Whether an open dialog has the keyboard; Backspace stops all drones nevertheless.
export const inDialog = () => document.querySelector('dialog[open]') !== null;

export function closeDialogs() {
  for (const dialog of document.querySelectorAll('dialog[open]')) dialog.close();
}

/// Asks; answers whether it was confirmed.
export function confirmed(title, words, yes) {
  const dialog = at('confirm');
  at('confirm-title').textContent = title;
  at('confirm-words').textContent = words;
  at('confirm-yes').textContent = yes;
  dialog.returnValue = '';
  dialog.showModal();
  return new Promise((done) => dialog.addEventListener('close', () => done(dialog.returnValue === 'yes'), { once: true }));
}

export class Operators {
  #connection;
  #held; // () => names of the drones that are held by who is signed in
  #busy = false;
  operators = [];

  constructor(connection, held) {
    this.#connection = connection;
    this.#held = held;
    at('sign').addEventListener('click', () => (this.operator ? this.#signOut() : this.#open()));
    at('sign-cancel').addEventListener('click', () => at('sign-dialog').close());
    at('sign-form').addEventListener('submit', (event) => {
      event.preventDefault();
      this.#signIn();
    });
    at('sign-dialog').addEventListener('close', () => (at('sign-phrase').value = ''));
    at('confirm-yes').addEventListener('click', () => at('confirm').close('yes'));
    at('confirm-no').addEventListener('click', () => at('confirm').close());
    connection.addEventListener('session', ({ detail }) => {
      at('sign-words').textContent = this.operator ? '' : detail; // the other stays beside it
      this.#show();
    });
  }

  get operator() {
    return this.#connection.operator;
  }

  get identity() {
    return this.#connection.identity;
  }

  async load() {
    const answer = await this.#connection.request('GET', 'operators');
    if (!answer.ok || JSON.stringify(answer.body.operators) === JSON.stringify(this.operators)) return;
    this.operators = answer.body.operators;
    at('sign-name').replaceChildren(...this.operators.map(({ name, identity }) => Object.assign(document.createElement('option'), { value: name, textContent: name, title: identity })));
    this.#show();
  }

  #show() {
    at('sign').hidden = at('who').hidden = this.operators.length === 0;
    at('sign').textContent = this.operator ? 'Sign out' : 'Sign in';
    at('who').textContent = this.operator ? `Signed in: ${this.operator}` : 'Nobody signed in';
    at('who').title = this.identity ?? '';
  }

  #open() {
    at('sign-refused').textContent = '';
    at('sign-dialog').showModal();
    (this.operators.length > 1 ? at('sign-name') : at('sign-phrase')).focus();
  }

  async #signIn() {
    if (this.#busy) return;
    this.#busy = true;
    at('sign-refused').textContent = 'The key is being unlocked.';
    const answer = await this.#connection.signIn(at('sign-name').value, at('sign-phrase').value);
    this.#busy = false;
    if (answer.ok) return at('sign-dialog').close();
    at('sign-refused').textContent = `Not signed in: ${answer.words}.`;
    at('sign-phrase').select();
    return at('sign-phrase').focus();
  }

  async #signOut() {
    const held = this.#held();
    const words = `${held.join(', ')}: what is in the air lands, and what you hold is given back.`;
    if (held.length && !(await confirmed(`Sign out ${this.operator}?`, words, 'Sign out'))) return;
    await this.#connection.signOut();
  }
}
