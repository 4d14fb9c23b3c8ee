// A picture from where the eye is, drawn by the server from the map itself.

import type { App } from '../app';
import { mapPath, said } from '../api/http';
import { fill, h } from './dom';
import { milliseconds } from './numbers';

type Output = 'color' | 'depth' | 'normal' | 'heat';
const OUTPUTS: [Output, string][] = [
  ['color', 'Colour'],
  ['depth', 'Depth'],
  ['normal', 'Normals'],
  ['heat', 'Heat of the last question'],
];
const WIDTH = 640;

export class PicturePanel {
  readonly element: HTMLElement;
  private readonly output = h('select', { id: 'picture-output' }, ...OUTPUTS.map(([value, name]) => h('option', { value }, name)));
  private readonly button = h('button', { type: 'button', class: 'primary', onclick: () => void this.draw() }, 'Draw from here');
  private readonly canvas = h('canvas', { class: 'picture', hidden: true, role: 'img' });
  private readonly note = h('p', { class: 'hint', role: 'status' }, 'The server draws what a camera would see from where you are now.');
  private readonly save = h('button', { type: 'button', hidden: true, onclick: () => this.download() }, 'Save as PNG');

  constructor(private readonly app: App) {
    this.element = h('div', { class: 'picture-panel' },
      h('div', { class: 'row' }, h('label', { for: 'picture-output' }, 'Show'), this.output),
      h('div', { class: 'row' }, this.button, this.save),
      this.canvas, this.note);
    app.found.watch((found) => {
      const heat = this.output.querySelector<HTMLOptionElement>('[value=heat]');
      if (heat) heat.disabled = found === null;
      if (found === null && this.output.value === 'heat') this.output.value = 'color';
    });
  }

  async draw(): Promise<void> {
    const { app } = this;
    const output = this.output.value as Output;
    const aspect = Math.min(2.4, Math.max(0.5, app.viewer.aspect));
    const width = Math.round(aspect >= 1 ? WIDTH : WIDTH * aspect);
    const height = Math.round(width / aspect);
    const focal = height / 2 / Math.tan((app.viewer.fieldOfView * Math.PI) / 360);
    const text = app.found.value?.text;
    const json = {
      world_from_camera: app.viewer.pose(),
      intrinsics: { fx: focal, fy: focal, cx: width / 2 - 0.5, cy: height / 2 - 0.5, width, height },
      output,
      encoding: output === 'depth' ? 'f32' : 'png',
      ...(output === 'heat' && text ? { text: { prompts: [text] } } : {}),
    };
    this.button.disabled = true;
    fill(this.note, 'Drawing …');
    try {
      const path = mapPath(app.mapId.value ?? 'default', '/render');
      const accept = output === 'depth' ? 'application/octet-stream' : 'image/png';
      const answer = await app.api.ask(path, { method: 'POST', json, accept });
      const spent = Number(answer.headers.get('orenx-server-us') ?? 0) / 1000;
      const epoch = answer.headers.get('orenx-epoch') ?? '';
      if (output === 'depth') this.paintDepth(await answer.arrayBuffer(), width, height);
      else await this.paintImage(await answer.blob());
      const name = OUTPUTS.find(([value]) => value === output)?.[1] ?? '';
      this.canvas.setAttribute('aria-label', `${name}, from where you are`);
      this.canvas.hidden = false;
      this.save.hidden = false;
      fill(this.note, `${width} × ${height}, drawn in ${milliseconds(spent)} from epoch ${epoch}`);
    } catch (error) {
      fill(this.note, said(error));
    } finally {
      this.button.disabled = false;
    }
  }

  private async paintImage(blob: Blob): Promise<void> {
    const image = await createImageBitmap(blob);
    this.canvas.width = image.width;
    this.canvas.height = image.height;
    this.canvas.getContext('2d')?.drawImage(image, 0, 0);
    image.close();
  }

  /** Near is light, far is dark; nothing stays empty. */
  private paintDepth(buffer: ArrayBuffer, width: number, height: number): void {
    const depth = new Float32Array(buffer);
    const far = depth.reduce((a, b) => Math.max(a, b), 0) || 1;
    this.canvas.width = width;
    this.canvas.height = height;
    const context = this.canvas.getContext('2d');
    if (!context) return;
    const image = context.createImageData(width, height);
    depth.forEach((z, i) => {
      if (z <= 0) return;
      const t = Math.sqrt(z / far);
      image.data.set([255 - 225 * t, 240 - 190 * t, 190 - 90 * t, 255], 4 * i);
    });
    context.putImageData(image, 0, 0);
  }

  private download(): void {
    this.canvas.toBlob((blob) => blob && saveBlob(blob, `${this.app.mapId.value ?? 'map'}-${this.output.value}.png`));
  }
}

/** Hands a file to the person. */
export function saveBlob(blob: Blob, name: string): void {
  const url = URL.createObjectURL(blob);
  h('a', { href: url, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(url), 60_000);
}
