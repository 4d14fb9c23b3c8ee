// Beside the 3D view: how one moves, what the surface shows, how finely it is drawn.

import type { App } from '../app';
import type { Detail } from '../mesh/feed';
import type { Drawn } from '../scene/viewer';
import type { Look } from '../scene/surface';
import { fill, h, iconButton } from './dom';
import { count } from './numbers';

const LOOKS: [Look, string][] = [['color', 'Colours'], ['normal', 'Normals'], ['height', 'Height']];
const DETAILS: [Detail | 'auto', string][] = [
  ['auto', 'Detail: automatic'],
  ['coarse', 'Coarse'],
  ['medium', 'Medium'],
  ['fine', 'Fine'],
];

export class Tools {
  readonly element: HTMLElement;
  private readonly drawn = h('p', { class: 'drawn' });
  private readonly mode = iconButton('orbit', 'Orbit or fly (G)', () => this.switchMode(), { 'aria-pressed': 'false' });
  private readonly points = iconButton('points', 'Points instead of triangles (P)', () => this.switchForm(), { 'aria-pressed': 'false', class: 'icon-button dots' });
  private text = '';

  constructor(private readonly app: App) {
    const look = h('select', { 'aria-label': 'What the surface shows', onchange: () => {
      app.viewer.surface.setLook(look.value as Look);
      app.viewer.invalidate();
    } }, ...LOOKS.map(([value, name]) => h('option', { value }, name)));
    const detail = h('select', { 'aria-label': 'How finely the surface is drawn', onchange: () => app.setDetail(detail.value as Detail | 'auto') },
      ...DETAILS.map(([value, name]) => h('option', { value }, name)));
    this.element = h('div', { class: 'tools' },
      h('div', { class: 'tool-group' },
        iconButton('fit', 'All of the map in view (F)', () => app.viewer.fit()), this.mode, this.points),
      h('div', { class: 'tool-group' }, look, detail), this.drawn);
    app.viewer.onDrawn = (drawn) => this.draw(drawn);
  }

  switchMode(): void {
    const { controls } = this.app.viewer;
    controls.mode = controls.mode === 'orbit' ? 'fly' : 'orbit';
    this.mode.setAttribute('aria-pressed', String(controls.mode === 'fly'));
    this.app.notice.set(controls.mode === 'fly' ? 'Flying: drag to look, W A S D to move' : 'Orbiting: drag to turn');
  }

  switchForm(): void {
    const { surface } = this.app.viewer;
    this.app.viewer.setForm(surface.isPoints ? 'triangles' : 'points');
    this.points.setAttribute('aria-pressed', String(surface.isPoints));
    this.app.notice.set(surface.isPoints ? 'Drawing points: the corners of the triangles' : 'Drawing triangles');
  }

  private draw(drawn: Drawn): void {
    const { surface } = this.app.viewer;
    const rate = drawn.framesPerSecond > 0 ? ` · ${Math.round(drawn.framesPerSecond)} frames/s` : '';
    const what = surface.isPoints ? `${count(surface.drawn)} points` : `${count(drawn.triangles)} triangles`;
    const text = `${what}, ${this.app.detail.value}${rate}`;
    const less = lessOf(drawn, surface.isPoints);
    this.drawn.dataset.triangles = String(drawn.triangles);
    if (text + less === this.text) return;
    this.text = text + less;
    fill(this.drawn, text, less === '' ? null : h('span', { class: 'less' }, less));
  }
}

/** What a slow machine leaves out, in words. */
function lessOf({ triangles, less }: Drawn, isPoints: boolean): string {
  if (!less) return '';
  const parts = [];
  if (less.pixels < 1) parts.push(`${Math.round(100 * less.pixels)} % of the pixels`);
  if (!isPoints && less.triangles < triangles) parts.push(`${count(less.triangles)} triangles`);
  return parts.length > 0 ? `Slow device: ${parts.join(' and ')} while it moves` : '';
}
