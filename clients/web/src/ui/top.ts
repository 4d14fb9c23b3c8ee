// The top of the page: which server and map, how it is, and what is wrong.

import type { App } from '../app';
import type { Link } from '../api/connection';
import type { MapStats } from '../api/types';
import { showHelp } from './dialogs';
import { fill, h, iconButton, svg } from './dom';
import { count, milliseconds, rate } from './numbers';
import { switchTheme } from './theme';

export class Top {
  readonly element: HTMLElement;
  readonly banner = h('div', { class: 'banner', role: 'alert', hidden: true });
  private readonly select = h('select', { id: 'map-select', 'aria-label': 'Map' });
  private readonly state = h('span', { class: 'link', role: 'status' });
  private readonly glance = h('div', { class: 'glance' });
  private readonly key = iconButton('key', 'Use another key', () => this.app.onOtherKey(), { hidden: true });
  private ticking: ReturnType<typeof setInterval> | undefined;

  constructor(private readonly app: App) {
    this.element = h('header', { class: 'top' },
      h('div', { class: 'brand' }, logo(), h('span', {}, 'orenx')),
      this.select, this.state, this.glance,
      h('div', { class: 'top-buttons' },
        this.key, iconButton('theme', 'Light or dark (T)', switchTheme),
        iconButton('help', 'Keys and gestures (?)', showHelp)));
    this.select.addEventListener('change', () => void app.choose(this.select.value));
    app.maps.watch(() => this.drawMaps());
    app.mapId.watch(() => this.drawMaps());
    app.connection.link.watch((link) => this.drawLink(link));
    app.connection.stats.watch((stats) => this.drawGlance(stats));
  }

  private drawMaps(): void {
    const ids = this.app.maps.value.map((map) => map.map_id).join('\n');
    if (this.select.dataset.ids !== ids) {
      this.select.dataset.ids = ids;
      const option = ({ map_id: id, problem }: { map_id: string; problem?: string }) =>
        h('option', { value: id, disabled: Boolean(problem) }, problem ? `${id} (not served)` : id);
      fill(this.select, ...this.app.maps.value.map(option));
    }
    this.select.value = this.app.mapId.value ?? '';
    this.select.hidden = this.app.maps.value.length === 0;
  }

  private drawGlance(stats: MapStats | null): void {
    const sample = this.app.history.samples.at(-1);
    if (!stats || !sample) {
      fill(this.glance);
      return;
    }
    const item = (value: string, name: string) => h('span', { class: 'glance-item' }, h('b', {}, value), ` ${name}`);
    const latency = this.app.history.samples.filter((s) => s.latencyMs !== null).at(-1)?.latencyMs;
    fill(this.glance,
      item(rate(sample.framesPerSecond), 'frames/s'),
      latency === undefined || latency === null ? null : item(milliseconds(latency), 'to be seen'),
      item(count(stats.frames), 'frames'),
      sample.refused > 0 ? item(count(sample.refused), 'refused') : null);
  }

  private drawLink(link: Link): void {
    const words = { live: 'Live', connecting: 'Connecting', starting: 'Starting', lost: 'Gone', key: 'Key needed', denied: 'Denied', 'no-map': 'No map' };
    this.state.className = `link ${link.kind}`;
    if (this.state.textContent !== words[link.kind]) fill(this.state, words[link.kind]);
    document.title = link.kind === 'live' ? `${this.app.mapId.value ?? ''} · orenx` : `${words[link.kind]} · orenx`;
    clearInterval(this.ticking);
    this.key.hidden = !this.app.api.hasKey;
    this.drawBanner(link);
    if (link.kind === 'lost' || link.kind === 'starting') {
      this.ticking = setInterval(() => this.drawBanner(link), 1000);
    }
  }

  private drawBanner(link: Link): void {
    this.banner.hidden = link.kind === 'live' || link.kind === 'connecting';
    document.body.classList.toggle('stale', link.kind === 'lost');
    if (this.banner.hidden) return;
    const isLocked = link.kind === 'key' || link.kind === 'denied';
    const again = isLocked
      ? h('button', { type: 'button', onclick: () => this.app.onOtherKey() }, link.kind === 'key' ? 'Enter a key' : 'Use another key')
      : h('button', { type: 'button', onclick: () => this.app.connection.retry() }, 'Try now');
    const wait = 'retryAt' in link ? Math.max(0, Math.ceil((link.retryAt - Date.now()) / 1000)) : 0;
    const soon = wait > 0 ? `Trying again in ${wait} s.` : 'Trying again …';
    const text = {
      live: '',
      connecting: '',
      starting: `The server is there but not ready yet. ${soon}`,
      lost: `The server is gone; what you see is what it said last. ${soon}`,
      key: 'The server asks for an API key.',
      denied: `The server refuses: ${'message' in link ? link.message : ''}`,
      'no-map': 'There is no such map on this server any more.',
    }[link.kind];
    // Said once; the seconds are for those who see them.
    const hadFocus = this.banner.contains(document.activeElement);
    fill(this.banner, h('span', {}, text), again);
    if (hadFocus) again.focus();
  }
}

function logo(): SVGElement {
  return svg('svg', { class: 'logo', viewBox: '0 0 32 32', 'aria-hidden': 'true' },
    svg('path', { d: 'M16 4 27 10.3v11.4L16 28 5 21.7V10.3zM16 28V16M5 10.3 16 16l11-5.7' }),
    svg('circle', { cx: 16, cy: 16, r: 3 }));
}
