// What the parts of the page share.

import { Api, mapPath } from './api/http';
import { Connection } from './api/connection';
import type { Encoders, MapStats, MapSummary, Match, TextAnswer } from './api/types';
import { History } from './history';
import type { Detail } from './mesh/feed';
import { MeshFeed } from './mesh/feed';
import { Heat } from './mesh/heat';
import type { Viewer } from './scene/viewer';
import { Signal } from './signal';

/** A finer mesh has four times the triangles; of more than these it is not loaded by itself. */
const ENOUGH_TRIANGLES = 400_000;
/** How often the list of maps is asked for, ms. */
const MAPS_MS = 5_000;
const LAST_MAP = 'orenx-map';

export interface Found {
  text: string;
  answer: TextAnswer;
  chosen: number;
}

export class App {
  readonly api = new Api();
  readonly connection = new Connection(this.api);
  readonly history = new History();
  readonly maps = new Signal<MapSummary[]>([]);
  readonly mapId = new Signal<string | null>(null);
  readonly encoders = new Signal<Encoders | null>(null);
  readonly found = new Signal<Found | null>(null);
  readonly detail = new Signal<Detail>('medium');
  /** Whether the server lets us change maps: what asks for snapshots finds out; null until then. */
  readonly isAdmin = new Signal<boolean | null>(null);
  /** Asks for another key. */
  onOtherKey: () => void = () => undefined;
  /** A word to who looks, that goes by itself. */
  readonly notice = new Signal<string>('');
  private feed: MeshFeed | null = null;
  private isDetailOwn = true;
  private wasTooFine = false;

  constructor(readonly viewer: Viewer) {
    this.connection.stats.watch((stats) => stats && this.take(stats));
    this.connection.link.watch(({ kind }) => {
      // A server that came back may be another one.
      if (kind === 'live') void this.refresh();
      if (kind === 'no-map') void this.chooseAnother();
    });
    setInterval(() => void (document.visibilityState === 'visible' && this.refresh()), MAPS_MS);
    void this.refresh();
  }

  private take(stats: MapStats): void {
    this.history.add(stats, performance.now());
    this.viewer.update(stats.map, stats.robots);
    this.suitDetail();
    this.feed?.follow(stats.map.epoch);
    if (stats.atoms > 0 && this.encoders.value?.map === null) void this.loadEncoders();
  }

  /** The list of maps; the first time, which one to show. */
  async refresh(): Promise<void> {
    try {
      const { maps } = await this.api.json<{ maps: MapSummary[] }>('/v1/maps');
      this.maps.set(maps);
      if (this.mapId.value === null) await this.chooseAnother();
    } catch {
      // The connection says what is wrong; until a map is chosen it has nothing to try.
      if (this.mapId.value === null) this.connection.listen('default');
    }
  }

  private async chooseAnother(): Promise<void> {
    if (this.maps.value.length === 0) return;
    const open = this.maps.value.filter((map) => !map.problem).map((map) => map.map_id);
    const last = sessionStorage.getItem(LAST_MAP);
    const gone = this.mapId.value;
    const choice = [last, 'default', open[0]].find((id) => id && id !== gone && open.includes(id));
    if (choice) await this.choose(choice);
  }

  async choose(mapId: string): Promise<void> {
    if (this.mapId.value === mapId && this.feed) return;
    this.mapId.set(mapId);
    sessionStorage.setItem(LAST_MAP, mapId);
    this.history.clear();
    this.found.set(null);
    this.encoders.set(null);
    this.viewer.clear();
    this.follow();
    this.connection.listen(mapId);
    await this.loadEncoders();
  }

  /** With another key: what was loaded without it, or refused, is loaded now. */
  startOver(): void {
    this.isAdmin.set(null);
    void this.refresh();
    void this.loadEncoders();
    this.follow(this.feed?.currentGeneration);
    this.connection.retry();
  }

  /** How finely the surface is loaded from now on. */
  setDetail(detail: Detail | 'auto'): void {
    this.isDetailOwn = detail === 'auto';
    this.wasTooFine = false;
    if (detail !== 'auto') this.load(detail);
  }

  private load(detail: Detail): void {
    if (detail === this.detail.value) return;
    this.detail.set(detail);
    this.follow(this.feed?.currentGeneration);
  }

  private follow(generation = 0): void {
    this.feed?.stop();
    const mapId = this.mapId.value;
    if (mapId === null) return;
    this.feed = new MeshFeed(this.api, mapId, this.detail.value, (pieces) => this.viewer.take(pieces), generation);
    const epoch = this.connection.stats.value?.map.epoch;
    if (epoch !== undefined) this.feed.follow(epoch);
  }

  /** As finely as this machine draws well, unless a person said how. */
  private suitDetail(): void {
    const { pace, surface } = this.viewer;
    const detail = this.detail.value;
    if (!this.isDetailOwn) return;
    if (detail === 'medium' && pace.isQuick && !this.wasTooFine && surface.triangles < ENOUGH_TRIANGLES) {
      this.load('fine');
    } else if (detail === 'fine' && (pace.isLess || surface.triangles > 4 * ENOUGH_TRIANGLES)) {
      this.wasTooFine = true;
      this.load('medium');
    } else if (detail === 'medium' && pace.isLeast && surface.triangles > ENOUGH_TRIANGLES) {
      // Only where the map is large: what a coarse lattice finds of thin walls has holes.
      this.load('coarse');
    }
  }

  async loadEncoders(): Promise<void> {
    const mapId = this.mapId.value;
    if (mapId === null) return;
    try {
      const encoders = await this.api.json<Encoders>(mapPath(mapId, '/encoders'));
      if (this.mapId.value === mapId) this.encoders.set(encoders);
    } catch {
      // The next epoch with atoms asks again.
    }
  }

  /** Looks for what a text means; lights it up, and goes to the best match. */
  async find(text: string): Promise<TextAnswer> {
    const mapId = this.mapId.value ?? 'default';
    const json = { prompts: [text], top_k: 12, places: true };
    const answer = await this.api.json<TextAnswer>(mapPath(mapId, '/query/text'), { method: 'POST', json });
    const heat = new Heat(answer.places_m ?? [], answer.place_score ?? []);
    this.viewer.setHeat(answer.matches.length > 0 ? heat : null);
    this.found.set({ text, answer, chosen: 0 });
    const best = answer.matches[0];
    if (best) this.show(best);
    return answer;
  }

  /** Goes to a match. */
  show(match: Match): void {
    const { value: found } = this.found;
    if (found) this.found.set({ ...found, chosen: match.id });
    this.viewer.boxes.show(found?.answer.matches ?? [match], match.id);
    const { center_m: center, half_size_m: half } = match.obb;
    this.viewer.see(center, Math.hypot(...half), match.best_view);
  }

  forget(): void {
    this.found.set(null);
    this.viewer.setHeat(null);
    this.viewer.boxes.clear();
    this.viewer.invalidate();
  }
}
