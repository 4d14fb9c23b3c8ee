// What the page asks a person, and what it tells about itself.

import type { App } from '../app';
import { fill, h, iconButton } from './dom';

/** Asks before something that cannot be undone. */
export function confirmed(question: string, yes: string): Promise<boolean> {
  return new Promise((done) => {
    const dialog = h('dialog', { class: 'dialog', 'aria-label': question },
      h('p', {}, question),
      h('form', { method: 'dialog', class: 'row end' },
        h('button', { value: 'no', autofocus: true }, 'Cancel'),
        h('button', { value: 'yes', class: 'danger' }, yes)));
    dialog.addEventListener('close', () => {
      done(dialog.returnValue === 'yes');
      dialog.remove();
    });
    document.body.append(dialog);
    dialog.showModal();
  });
}

const KEYS: [string, string][] = [
  ['/', 'ask where something is'],
  ['drag · arrows', 'turn'],
  ['wheel · pinch · + −', 'nearer and farther'],
  ['right drag · shift drag · two fingers', 'shift'],
  ['W A S D · Q E', 'walk, sink and rise (Shift: faster)'],
  ['G', 'orbit or fly'],
  ['F', 'all of the map in view'],
  ['click', 'what is there, and how far'],
  ['L', 'draw the slice'],
  ['[ ]', 'lower and raise the slice'],
  ['R', 'a picture from here'],
  ['1 2 3 4', 'health, slice, picture, maps'],
  ['P', 'points instead of triangles'],
  ['T', 'light or dark'],
  ['Esc', 'forget the matches, close'],
  ['?', 'this list'],
];

export function showHelp(): void {
  const rows = KEYS.flatMap(([keys, what]) => [
    h('dt', {}, ...keys.split(' · ').flatMap((key, i) => [i > 0 ? ' or ' : null, h('kbd', {}, key)])),
    h('dd', {}, what),
  ]);
  const dialog = h('dialog', { class: 'dialog help', 'aria-label': 'Keys and gestures' },
    h('div', { class: 'dialog-head' }, h('h2', {}, 'Keys and gestures'), iconButton('close', 'Close', () => dialog.close())),
    h('p', { class: 'hint' }, 'Keys for moving work while the map has the focus: click it, or reach it with Tab.'),
    h('dl', { class: 'keys' }, ...rows));
  dialog.addEventListener('close', () => dialog.remove());
  document.body.append(dialog);
  dialog.showModal();
}

/** Asks for a key when the server wants one. */
export class KeyDialog {
  private readonly input = h('input', { type: 'password', id: 'api-key', autocomplete: 'off', required: true });
  private readonly problem = h('p', { class: 'hint', role: 'alert' });
  private readonly head = h('h2', {});
  private readonly dialog: HTMLDialogElement;

  constructor(private readonly app: App) {
    const form = h('form', { method: 'dialog', onsubmit: () => this.take() },
      this.head,
      h('p', {}, 'It is kept in this tab alone, and sent to this server alone.'),
      h('label', { for: 'api-key' }, 'API key'), this.input, this.problem,
      h('div', { class: 'row end' },
        h('button', { type: 'button', onclick: () => this.dialog.close() }, 'Cancel'),
        h('button', { type: 'submit', class: 'primary' }, 'Go on')));
    this.dialog = h('dialog', { class: 'dialog', 'aria-label': 'API key' }, form);
    document.body.append(this.dialog);
    app.api.onUnauthenticated = () =>
      this.open('This server asks for a key', app.api.hasKey ? 'The server does not know this key.' : '');
    app.onOtherKey = () => this.open('Another key', '');
  }

  private open(head: string, problem: string): void {
    if (this.dialog.open) return;
    fill(this.head, head);
    fill(this.problem, problem);
    this.input.value = '';
    this.dialog.showModal();
    this.input.focus();
  }

  private take(): void {
    this.app.api.setKey(this.input.value.trim());
    // Once the dialog is closed, so that it can ask again.
    setTimeout(() => this.app.startOver());
  }
}
