// Plan or three dimensions: which of the two is seen. What the latter needs is loaded when it is first asked for.

const at = (id) => document.getElementById(id);

export class SpaceSwitch {
  #plan;
  #draft;
  #ink;
  #libraries;
  #view = null; // SpaceView, once it was asked for
  #on = false;

  /// `libraries`: whether three.js is built in.
  constructor(plan, draft, ink, libraries) {
    this.#plan = plan;
    this.#draft = draft;
    this.#ink = ink;
    this.#libraries = libraries;
    at('space').addEventListener('click', () => this.toggle());
    at('draw').addEventListener('click', () => this.toggle(false)); // paths are drawn on the plan
    if (localStorage.getItem('view') === 'space') this.toggle(true);
  }

  /// What the buttons for zoom and fit are for.
  get seen() {
    return this.#on && this.#view ? this.#view : this.#plan;
  }

  toggle(on = !this.#on) {
    if (on === this.#on) return;
    if (on && !this.#libraries) {
      this.#say('This station was built without its 3-D view and charts, since npm was missing: the plan shows what there is.');
      return;
    }
    if (on && this.#draft.on) this.#draft.toggle(false);
    this.#on = on;
    this.#say('');
    this.#show();
    localStorage.setItem('view', on ? 'space' : 'plan');
    if (on && !this.#view) this.#load();
  }

  draw(now, ageOf) {
    if (!this.#on) this.#plan.draw(now, ageOf);
    if (!this.#on || !this.#view) return;
    Object.assign(this.#view, { drones: this.#plan.drones, trails: this.#plan.trails, selected: this.#plan.selected, previews: this.#plan.previews, fence: this.#plan.fence });
    this.#view.draw(now, ageOf);
  }

  async #load() {
    this.#say('Loading the 3-D view');
    try {
      const { SpaceView } = await import('./scene.js');
      this.#view ??= new SpaceView(at('scene'), this.#ink);
      this.#say('');
    } catch (error) {
      this.toggle(false);
      this.#say(`No 3-D view in this browser: ${error.message}`);
    }
  }

  #show() {
    const held = [at('map'), at('scene')].includes(document.activeElement);
    at('map').hidden = this.#on;
    at('scene').hidden = !this.#on;
    at('plan').classList.toggle('space', this.#on);
    at('space').setAttribute('aria-pressed', this.#on);
    at('plan-title').textContent = this.#on ? '3-D view' : 'Plan view';
    if (held) at(this.#on ? 'scene' : 'map').focus();
  }

  #say(words) {
    at('space-words').textContent = words;
  }
}
