// The slice: a height, the map at that height, and what is exactly at a point.

import type { App } from '../app';
import { Unreachable, mapPath, said } from '../api/http';
import type { PointsAnswer, Triple } from '../api/types';
import type { Slice } from '../scene/slice';
import { distanceAt, sliceColor } from '../scene/slice';
import { fill, h } from './dom';
import { metres, place } from './numbers';

/** Cells of a slice, about: enough for a room, and 160 kB. */
const CELLS = 40_000;
/** Between two slices while the map changes, ms. */
const INTERVAL_MS = 400;
const STATES = ['unknown', 'free', 'occupied'];

export class SlicePanel {
  readonly element: HTMLElement;
  private readonly toggle = h('input', { type: 'checkbox', id: 'slice-on', role: 'switch' });
  private readonly height = h('input', {
    type: 'range', id: 'slice-height', min: '0', max: '2.5', step: '0.01', value: '0.5',
  });
  private readonly heightText = h('output', { for: 'slice-height' });
  private readonly canvas = h('canvas', { class: 'slice-map', role: 'img', 'aria-label': 'The slice from above' });
  private readonly reading = h('div', { class: 'reading', role: 'status' });
  private readonly fields = ['x', 'y', 'z'].map((axis) =>
    h('input', { type: 'number', step: '0.01', 'aria-label': `${axis}, metres`, placeholder: axis, required: true }));
  private slice: Slice | null = null;
  private asked = { epoch: -1, z: NaN };
  private loading = false;
  private asking = false;
  private nextPoint: Triple | null = null;
  private isTouched = false;

  constructor(private readonly app: App) {
    const form = h('form', { class: 'point-form', onsubmit: (event) => this.submit(event) },
      ...this.fields, h('button', { type: 'submit' }, 'Ask'));
    const legend = h('div', { class: 'legend', 'aria-hidden': 'true' }, h('canvas', { class: 'legend-bar', width: 240, height: 1 }),
      h('div', { class: 'legend-marks' }, ...['−0.5', '0', '0.5', '1', '1.5 m'].map((mark) => h('span', {}, mark))));
    this.element = h('div', { class: 'slice-panel' },
      h('label', { class: 'switch', for: 'slice-on' }, this.toggle, h('span', {}, 'Draw the slice in the map')),
      h('div', { class: 'row' }, h('label', { for: 'slice-height' }, 'Height'), this.height, this.heightText),
      this.canvas, legend, this.reading,
      h('section', {}, h('h3', {}, 'Ask a point'), form,
        h('p', { class: 'hint' }, 'Signed distance to the nearest surface: positive in free space, negative inside. Point at the slice, or type a place.')));
    paintLegend(legend.querySelector('canvas'));
    this.toggle.addEventListener('change', () => this.show());
    this.height.addEventListener('input', () => {
      this.isTouched = true;
      this.show();
    });
    this.canvas.addEventListener('pointermove', (event) => this.hover(event));
    this.canvas.addEventListener('pointerdown', (event) => this.hover(event));
    app.connection.stats.watch((stats) => {
      if (stats?.map.bounds) this.setRange(stats.map.bounds.min[2], stats.map.bounds.max[2]);
      void this.load();
    });
    app.mapId.watch(() => {
      this.slice = null;
      this.isTouched = false;
      this.asked = { epoch: -1, z: NaN };
      this.reading.replaceChildren();
    });
    this.show();
  }

  get z(): number {
    return Number(this.height.value);
  }

  get isOn(): boolean {
    return this.toggle.checked;
  }

  /** Whether somebody looks at the slice. */
  private get isSeen(): boolean {
    return this.isOn || this.element.offsetParent !== null;
  }

  setOn(on: boolean): void {
    this.toggle.checked = on;
    this.show();
  }

  /** Up or down by some steps. */
  step(steps: number): void {
    this.isTouched = true;
    this.height.value = String(this.z + steps * 0.05);
    if (!this.isOn) this.toggle.checked = true;
    this.show();
  }

  private setRange(low: number, high: number): void {
    this.height.min = low.toFixed(2);
    this.height.max = high.toFixed(2);
    // At a robot's height, until somebody says another one.
    if (!this.isTouched) this.height.value = String(Math.max(low, 0) + Math.min(0.5, (high - Math.max(low, 0)) / 3));
    fill(this.heightText, metres(this.z));
  }

  private show(): void {
    fill(this.heightText, metres(this.z));
    this.app.viewer.slice.show(this.isOn ? this.slice : null);
    if (!this.isOn) this.app.viewer.pointer.hide();
    this.app.viewer.invalidate();
    void this.load();
  }

  /** Asks for the slice, if it is another one now. */
  async load(): Promise<void> {
    const stats = this.app.connection.stats.value;
    const mapId = this.app.mapId.value;
    if (this.loading || !stats?.map.bounds || mapId === null || !this.isSeen) return;
    const { min, max } = stats.map.bounds;
    const asked = { epoch: stats.map.epoch, z: this.z };
    if (asked.epoch === this.asked.epoch && asked.z === this.asked.z) return;
    const isSameHeight = asked.z === this.asked.z;
    this.loading = true;
    this.asked = asked;
    try {
      const area = Math.max((max[0] - min[0]) * (max[1] - min[1]), 0.01);
      const res = Math.max(0.02, Math.sqrt(area / CELLS));
      const query = new URLSearchParams({ z: String(asked.z), res: res.toFixed(4) });
      const answer = await this.app.api.ask(mapPath(mapId, `/slice.bin?${query.toString()}`), { accept: 'application/octet-stream' });
      const slice = await sliceOf(answer);
      if (mapId === this.app.mapId.value) this.take(slice);
    } catch (error) {
      if (!(error instanceof Unreachable)) fill(this.reading, said(error));
    } finally {
      // A slider is followed at once, a map that changes at leisure.
      setTimeout(() => {
        this.loading = false;
        void this.load();
      }, isSameHeight ? INTERVAL_MS : 30);
    }
  }

  private take(slice: Slice): void {
    this.slice = slice;
    if (this.isOn) {
      this.app.viewer.slice.show(slice);
      this.app.viewer.invalidate();
    }
    paint(this.canvas, slice);
  }

  private hover(event: PointerEvent): void {
    if (!this.slice) return;
    const box = this.canvas.getBoundingClientRect();
    const { origin, resolution, width, height } = this.slice;
    const x = origin[0] + ((event.clientX - box.left) / box.width) * width * resolution;
    const y = origin[1] + (1 - (event.clientY - box.top) / box.height) * height * resolution;
    this.point([x, y, origin[2]]);
  }

  /** The pointer is over the 3D view: the value under it, if the slice is drawn. */
  hoverAt(clientX: number, clientY: number): void {
    if (!this.isOn || !this.slice) return;
    const at = this.app.viewer.atHeight(clientX, clientY, this.slice.origin[2]);
    if (at && !Number.isNaN(distanceAt(this.slice, at[0], at[1]))) this.point(at);
  }

  private submit(event: Event): void {
    event.preventDefault();
    const at = this.fields.map((field) => field.valueAsNumber) as Triple;
    if (at.every(Number.isFinite)) this.point(at);
  }

  /** Asks the server about a point; of points that come too fast, the last one. */
  point(at: Triple): void {
    this.nextPoint = at;
    this.fields.forEach((field, axis) => {
      if (document.activeElement !== field) field.value = (at[axis] ?? 0).toFixed(2);
    });
    if (!this.asking) void this.askPoints();
  }

  private async askPoints(): Promise<void> {
    this.asking = true;
    while (this.nextPoint) {
      const at = this.nextPoint;
      this.nextPoint = null;
      try {
        const json = { points_m: [at], fields: ['distance', 'gradient', 'state'] };
        const path = mapPath(this.app.mapId.value ?? 'default', '/query/points');
        const answer = await this.app.api.json<PointsAnswer>(path, { method: 'POST', json });
        this.read(at, answer);
      } catch (error) {
        fill(this.reading, said(error));
      }
    }
    this.asking = false;
  }

  private read(at: Triple, answer: PointsAnswer): void {
    const distance = answer.distance_m?.[0] ?? null;
    const state = STATES[answer.state?.[0] ?? 0] ?? 'unknown';
    const [x, y, z] = answer.gradient?.[0] ?? [null, null, null];
    const gradient: Triple | null = x === null || y === null || z === null ? null : [x, y, z];
    this.app.viewer.pointer.show(at, gradient, Math.max(0.25, this.app.viewer.controls.radius * 0.06));
    this.app.viewer.invalidate();
    fill(this.reading,
      h('span', { class: 'reading-value', 'data-distance': distance ?? '' }, distance === null ? 'unknown' : metres(distance, 3)),
      distance !== null && h('span', { class: `state ${state}` }, state),
      h('span', { class: 'reading-rest' }, `at ${place(at)}`, gradient ? `, gradient ${place(gradient)}` : ''));
  }
}

/** A raw slice with its place in the headers. */
async function sliceOf(answer: Response): Promise<Slice> {
  const header = (name: string) => answer.headers.get(`orenx-${name}`) ?? '';
  const origin = header('origin-m').split(',').map(Number) as Triple;
  return {
    origin,
    resolution: Number(header('resolution-m')),
    width: Number(header('width')),
    height: Number(header('height')),
    epoch: Number(header('epoch')),
    distance: new Float32Array(await answer.arrayBuffer()),
  };
}

/** From above: x to the right, y up. */
function paint(canvas: HTMLCanvasElement, slice: Slice): void {
  const { width, height, distance } = slice;
  canvas.width = width;
  canvas.height = height;
  const context = canvas.getContext('2d');
  if (!context) return;
  const image = context.createImageData(width, height);
  distance.forEach((d, i) => {
    if (Number.isNaN(d)) return;
    const [column, row] = [i % width, height - 1 - Math.floor(i / width)];
    const beside = [column + 1 < width ? distance[i + 1] : d, distance[i + width] ?? d];
    const isLine = beside.some((other) => other !== undefined && other < 0 !== d < 0);
    image.data.set([...(isLine ? ([255, 255, 255] as const) : sliceColor(d)), 255], 4 * (column + row * width));
  });
  context.putImageData(image, 0, 0);
}

function paintLegend(canvas: HTMLCanvasElement | null): void {
  const context = canvas?.getContext('2d');
  if (!canvas || !context) return;
  const image = context.createImageData(canvas.width, 1);
  for (let i = 0; i < canvas.width; i += 1) {
    image.data.set([...sliceColor(-0.5 + (2 * i) / canvas.width), 255], 4 * i);
  }
  context.putImageData(image, 0, 0);
}
