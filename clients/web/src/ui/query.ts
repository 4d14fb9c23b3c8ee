// Where is …? A text, its matches, and why there may be no answer.

import type { App, Found } from '../app';
import { said } from '../api/http';
import type { Encoders, Match } from '../api/types';
import { fill, h, icon, iconButton } from './dom';
import { metres, milliseconds } from './numbers';

/** Below and above it, pixels. */
const MARGIN = 30;
/** Asked with one click, where the map has language. */
const SUGGESTIONS = ['where is the blanket?', 'something to sit on', 'lamp', 'plant'];

export class QueryBox {
  readonly element: HTMLElement;
  readonly input = h('input', {
    type: 'search', id: 'query', placeholder: 'Where is …?', autocomplete: 'off', enterkeyhint: 'search',
    'aria-label': 'Where is what? Ask in words', maxlength: 500,
  });
  private readonly chips = h('div', { class: 'chips' });
  private readonly results = h('div', { class: 'results', hidden: true, role: 'region', 'aria-label': 'Matches' });
  private readonly why = h('p', { class: 'why', role: 'status' });
  private busy = false;

  constructor(private readonly app: App) {
    const form = h('form', { class: 'query-form', role: 'search', onsubmit: (event) => {
      event.preventDefault();
      void this.ask(this.input.value);
    } }, icon('search'), this.input,
    h('kbd', { 'aria-hidden': 'true' }, '/'),
    h('button', { type: 'submit', class: 'primary' }, 'Find'));
    this.element = h('div', { class: 'query' }, this.results, this.chips, this.why, form);
    app.encoders.watch((encoders) => this.explain(encoders));
    app.found.watch((found) => this.show(found));
    this.input.addEventListener('keydown', (event) => this.key(event));
    // The map is shown above it, whatever it has to say.
    new ResizeObserver(() => this.cover()).observe(this.element);
  }

  private cover(): void {
    const { offsetHeight: height } = this.element;
    this.app.viewer.setCovered({ below: height > 0 ? height + MARGIN : 0 });
  }

  async ask(text: string): Promise<void> {
    const words = text.trim();
    if (words === '' || this.busy) return;
    this.input.value = words;
    this.busy = true;
    this.element.classList.add('busy');
    try {
      const answer = await this.app.find(words);
      fill(this.why, answer.matches.length === 0 ? `Nothing in this map fits “${words}”.` : '');
    } catch (error) {
      this.app.forget();
      fill(this.why, said(error));
    } finally {
      this.busy = false;
      this.element.classList.remove('busy');
    }
  }

  /** Says plainly why words would find nothing. */
  private explain(encoders: Encoders | null): void {
    const problem = problemOf(encoders);
    this.input.disabled = problem !== '';
    this.element.classList.toggle('off', problem !== '');
    fill(this.why, problem);
    const chip = (text: string) => h('button', { type: 'button', class: 'chip', onclick: () => void this.ask(text) }, text);
    fill(this.chips, ...(encoders !== null && problem === '' ? SUGGESTIONS.map(chip) : []));
  }

  private show(found: Found | null): void {
    this.results.hidden = found === null || found.answer.matches.length === 0;
    this.chips.hidden = found !== null;
    if (!found) return;
    const { matches, server_us: spent } = found.answer;
    const best = matches[0]?.score ?? 1;
    const head = h('div', { class: 'results-head' },
      h('span', {}, `${matches.length} ${matches.length === 1 ? 'match' : 'matches'} for “${found.text}”`),
      h('span', { class: 'muted' }, milliseconds(spent / 1000)),
      iconButton('close', 'Forget the matches', () => {
        this.app.forget();
        this.input.focus();
      }));
    const list = h('ol', { class: 'matches' }, ...matches.map((match) => this.row(match, best, found.chosen)));
    const hadFocus = this.results.contains(document.activeElement);
    fill(this.results, head, list);
    // At once: who found something goes there now.
    this.cover();
    if (hadFocus) list.querySelector<HTMLElement>('[aria-current=true]')?.focus();
  }

  private row(match: Match, best: number, chosen: number): HTMLElement {
    const bar = h('span', { class: 'score-bar', 'aria-hidden': 'true' });
    bar.style.setProperty('--share', String(Math.max(0, match.score / best)));
    const size = match.extent_m.map((side) => side.toFixed(1)).join(' × ');
    return h('li', {}, h('button', {
      type: 'button', class: 'match', 'aria-current': String(match.id === chosen),
      onclick: () => this.app.show(match),
      onkeydown: (event) => this.walk(event as KeyboardEvent),
    },
    h('span', { class: 'rank' }, String(match.id + 1)),
    h('span', { class: 'score' }, match.score.toFixed(2), bar),
    h('span', { class: 'size' }, `${size} m`),
    h('span', { class: 'muted' }, `at ${match.centroid_m.map((x) => metres(x, 1).replace(' m', '')).join(', ')}`)));
  }

  /** Arrows go from match to match. */
  private walk(event: KeyboardEvent): void {
    const step = { ArrowDown: 1, ArrowUp: -1 }[event.key];
    if (step === undefined) return;
    event.preventDefault();
    const all = [...this.results.querySelectorAll<HTMLElement>('.match')];
    all[all.indexOf(event.currentTarget as HTMLElement) + step]?.focus();
  }

  private key(event: KeyboardEvent): void {
    if (event.key === 'Escape') {
      if (this.app.found.value) this.app.forget();
      else this.input.blur();
    }
    if (event.key === 'ArrowDown') {
      event.preventDefault();
      this.results.querySelector<HTMLElement>('.match')?.focus();
    }
  }
}

function problemOf(encoders: Encoders | null): string {
  if (!encoders) return '';
  if (!encoders.server) {
    return 'This server has no text encoder, so it cannot be asked in words. Setting encoder.kind gives it one.';
  }
  if (!encoders.map) return 'This map has no language yet: no robot has sent features or labels.';
  if (encoders.server.encoder_id !== encoders.map.encoder_id) {
    return `The server’s encoder (${encoders.server.encoder_id}) is not the one of this map (${encoders.map.encoder_id}).`;
  }
  return '';
}
