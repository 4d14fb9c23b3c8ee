// Maps and their snapshots: which there are, new ones, and the end of old ones.

import type { App } from '../app';
import { Refused, mapPath, said } from '../api/http';
import type { MapSummary, Snapshot } from '../api/types';
import { confirmed } from './dialogs';
import { fill, h, iconButton } from './dom';
import { bytes, count } from './numbers';
import { saveBlob } from './picture';

export class MapsPanel {
  readonly element: HTMLElement;
  private readonly list = h('ul', { class: 'maps' });
  private readonly name = h('input', { type: 'text', id: 'map-name', placeholder: 'hall', required: true, maxlength: 64, autocomplete: 'off', spellcheck: 'false' });
  private readonly status = h('p', { class: 'hint', role: 'status' });
  private readonly snapshots = h('ul', { class: 'snapshots' });
  private readonly snapshotName = h('input', { type: 'text', id: 'snapshot-name', placeholder: 'a name, if you like', maxlength: 64, autocomplete: 'off', spellcheck: 'false' });
  private readonly file = h('input', { type: 'file', id: 'snapshot-file', accept: '.orenx' });
  private readonly snapshotSection: HTMLElement;
  /** What takes snapshots, or why there are none. */
  private readonly snapshotWays: HTMLElement;
  private readonly noSnapshots = h('p', { class: 'hint' });
  /** Says which role it takes to change something. */
  private readonly looksOnly = h('div', { class: 'looks-only', hidden: true },
    h('p', {}, 'This key may look and ask. To make, empty or delete maps, and for their snapshots, it takes a key with the role ', h('b', {}, 'admin'), '.'),
    h('button', { type: 'button', onclick: () => this.app.onOtherKey() }, 'Use another key'));

  constructor(private readonly app: App) {
    const createButton = h('button', { type: 'submit' }, 'Create');
    const emptyButton = h('button', { type: 'button', class: 'danger', onclick: () => void this.reset() }, 'Empty the map …');
    const create = h('form', { class: 'row', onsubmit: (event) => {
      event.preventDefault();
      void this.create();
    } }, h('label', { for: 'map-name' }, 'New map'), this.name, createButton);
    const take = h('form', { class: 'row', onsubmit: (event) => {
      event.preventDefault();
      void this.takeSnapshot();
    } }, h('label', { for: 'snapshot-name' }, 'Now'), this.snapshotName, h('button', { type: 'submit' }, 'Take'));
    this.file.addEventListener('change', () => void this.upload());
    this.snapshotWays = h('div', { class: 'ways' }, take,
      h('div', { class: 'row' }, h('label', { for: 'snapshot-file' }, 'From a file'), this.file));
    this.snapshotSection = h('section', { hidden: true }, h('h3', {}, 'Snapshots of this map'),
      this.snapshots, this.snapshotWays, this.noSnapshots);
    const save = (ending: string) => h('button', {
      type: 'button', 'aria-label': `Save the surface as ${ending.toUpperCase()}`, onclick: () => void this.saveMesh(ending),
    }, ending.toUpperCase());
    this.element = h('div', { class: 'maps-panel' }, this.list, this.looksOnly, create, this.status,
      h('section', { class: 'stack' }, h('h3', {}, 'This map'), h('div', { class: 'row wrap' },
        h('span', {}, 'Save the surface'), save('ply'), save('glb')),
        h('div', { class: 'row' }, emptyButton)),
      this.snapshotSection);
    app.isAdmin.watch((isAdmin) => {
      for (const control of [this.name, createButton, emptyButton]) control.disabled = isAdmin === false;
      this.looksOnly.hidden = isAdmin !== false;
      this.draw();
      if (isAdmin === null) void this.loadSnapshots();
    });
    app.maps.watch(() => {
      this.draw();
      // A timer of the server takes some too.
      if (this.snapshotSection.offsetParent !== null) void this.loadSnapshots();
    });
    app.mapId.watch(() => {
      this.draw();
      void this.loadSnapshots();
    });
  }

  private get mapId(): string {
    return this.app.mapId.value ?? 'default';
  }

  private draw(): void {
    const shown = JSON.stringify([this.app.maps.value.map((map) => [map.map_id, map.problem, map.bounds === null]), this.app.mapId.value, this.app.isAdmin.value]);
    for (const map of this.app.maps.value) {
      const facts = this.list.querySelector(`[data-map="${CSS.escape(map.map_id)}"] .map-facts`);
      if (facts) fill(facts, factsOf(map));
    }
    if (this.list.dataset.shown === shown) return;
    this.list.dataset.shown = shown;
    fill(this.list, ...this.app.maps.value.map((map) => this.row(map)));
  }

  private row(map: MapSummary): HTMLElement {
    const isShown = map.map_id === this.app.mapId.value;
    return h('li', { class: `map ${map.problem ? 'broken' : ''}`, 'data-map': map.map_id },
      h('button', {
        type: 'button', class: 'map-choice', 'aria-pressed': String(isShown), disabled: Boolean(map.problem),
        onclick: () => void this.app.choose(map.map_id),
      }, h('span', { class: 'map-name' }, map.map_id), h('span', { class: 'map-facts' }, factsOf(map))),
      map.map_id !== 'default' &&
        iconButton('trash', `Delete the map ${map.map_id}`, () => void this.remove(map.map_id), {
          class: 'icon-button danger', disabled: this.app.isAdmin.value === false,
        }));
  }

  /** Does something that may be refused, and says so. */
  private async attempt(what: string, work: () => Promise<unknown>): Promise<boolean> {
    fill(this.status, `${what} …`);
    try {
      await work();
      fill(this.status);
      return true;
    } catch (error) {
      fill(this.status, said(error));
      return false;
    }
  }

  private async create(): Promise<void> {
    const name = this.name.value.trim();
    const made = await this.attempt('Creating', () => this.app.api.json(mapPath(name), { method: 'PUT' }));
    if (!made) return;
    this.name.value = '';
    await this.app.refresh();
    await this.app.choose(name);
  }

  private async remove(mapId: string): Promise<void> {
    const question = `Delete the map “${mapId}” and all that is stored of it? This cannot be undone.`;
    if (!(await confirmed(question, 'Delete'))) return;
    await this.attempt('Deleting', () => this.app.api.json(mapPath(mapId), { method: 'DELETE' }));
    await this.app.refresh();
  }

  private async reset(): Promise<void> {
    const question = `Empty the map “${this.mapId}”? What robots mapped so far is gone from memory.`;
    if (!(await confirmed(question, 'Empty it'))) return;
    await this.attempt('Emptying', () => this.app.api.json(mapPath(this.mapId, '/reset'), { method: 'POST' }));
  }

  private async saveMesh(ending: string): Promise<void> {
    await this.attempt('Making the mesh', async () => {
      const ask = { accept: '*/*', patienceMs: 60_000 };
      const answer = await this.app.api.ask(mapPath(this.mapId, `/mesh.${ending}`), ask);
      saveBlob(await answer.blob(), `${this.mapId}.${ending}`);
    });
  }

  /** Tells, too, whether the key may change anything. */
  async loadSnapshots(): Promise<void> {
    if (this.app.mapId.value === null) return;
    const mapId = this.mapId;
    try {
      const { snapshots } = await this.app.api.json<{ snapshots: Snapshot[] }>(mapPath(mapId, '/snapshots'));
      if (mapId !== this.mapId) return;
      this.app.isAdmin.set(true);
      this.showSnapshots('');
      // Rows stay while they are the same: a button that is pressed must stay.
      const shown = JSON.stringify([mapId, snapshots]);
      if (this.snapshots.dataset.shown === shown) return;
      this.snapshots.dataset.shown = shown;
      const none = h('li', { class: 'empty' }, 'None yet.');
      fill(this.snapshots, ...(snapshots.length > 0 ? snapshots.map((one) => this.snapshotRow(one)) : [none]));
    } catch (error) {
      if (!(error instanceof Refused) || error.status === 401 || mapId !== this.mapId) return;
      this.app.isAdmin.set(error.status !== 403);
      // As of a server without storage.
      this.showSnapshots(said(error));
    }
  }

  /** The list and the ways to more of them, or why there are none. */
  private showSnapshots(problem: string): void {
    this.snapshotSection.hidden = this.app.isAdmin.value === false;
    this.snapshots.hidden = problem !== '';
    this.snapshotWays.hidden = problem !== '';
    fill(this.noSnapshots, problem);
  }

  private snapshotRow(snapshot: Snapshot): HTMLElement {
    const path = mapPath(this.mapId, `/snapshots/${encodeURIComponent(snapshot.name)}`);
    const made = new Date(snapshot.created_ns / 1e6).toLocaleString();
    const facts = snapshot.problem
      ? `cannot be read: ${snapshot.problem}`
      : `${made}, ${bytes(snapshot.bytes)}, ${count(snapshot.frames)} frames`;
    return h('li', { class: 'snapshot' },
      h('span', { class: 'map-name' }, snapshot.name, h('span', { class: snapshot.problem ? 'map-facts bad' : 'map-facts' }, facts)),
      iconButton('reset', `Restore ${snapshot.name}`, () => void this.restore(snapshot.name, path)),
      iconButton('down', `Download ${snapshot.name}`, () => void this.attempt('Downloading', async () => {
        const ask = { accept: 'application/octet-stream', patienceMs: 0 };
        saveBlob(await (await this.app.api.ask(path, ask)).blob(), `${this.mapId}-${snapshot.name}.orenx`);
      })),
      iconButton('trash', `Delete ${snapshot.name}`, () => void this.removeSnapshot(snapshot.name, path), { class: 'icon-button danger' }));
  }

  private async takeSnapshot(): Promise<void> {
    const name = this.snapshotName.value.trim();
    const ask = { method: 'POST', json: name === '' ? {} : { name }, patienceMs: 60_000 } as const;
    if (await this.attempt('Taking a snapshot', () => this.app.api.json(mapPath(this.mapId, '/snapshots'), ask))) {
      this.snapshotName.value = '';
    }
    await this.loadSnapshots();
  }

  private async upload(): Promise<void> {
    const file = this.file.files?.[0];
    if (!file) return;
    const name = file.name.replace(/\.orenx$/, '').toLowerCase().replaceAll(/[^a-z0-9_-]/g, '-').slice(0, 64);
    const path = mapPath(this.mapId, `/snapshots/${encodeURIComponent(name)}`);
    await this.attempt('Uploading', () => this.app.api.ask(path, { method: 'PUT', body: file, patienceMs: 0 }));
    this.file.value = '';
    await this.loadSnapshots();
  }

  private async restore(name: string, path: string): Promise<void> {
    if (!(await confirmed(`Go back to the snapshot “${name}”? What came since is gone.`, 'Restore'))) return;
    await this.attempt('Restoring', () => this.app.api.ask(`${path}/restore`, { method: 'POST', patienceMs: 60_000 }));
  }

  private async removeSnapshot(name: string, path: string): Promise<void> {
    if (!(await confirmed(`Delete the snapshot “${name}”?`, 'Delete'))) return;
    await this.attempt('Deleting', () => this.app.api.ask(path, { method: 'DELETE' }));
    await this.loadSnapshots();
  }
}

function factsOf(map: MapSummary): string {
  if (map.problem) return `not served: ${map.problem}`;
  if (!map.bounds) return 'empty';
  const { min, max } = map.bounds;
  return `${max.map((high, axis) => (high - (min[axis] ?? 0)).toFixed(1)).join(' × ')} m, epoch ${count(map.epoch)}`;
}
