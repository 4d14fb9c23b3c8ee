// The page: the 3D view, what stands around it, and the keys.

import './style/base.css';
import './style/layout.css';
import './style/parts.css';
import './style/ask.css';
import './style/phone.css';

import { App } from './app';
import { said } from './api/http';
import type { Triple } from './api/types';
import { Viewer } from './scene/viewer';
import { KeyDialog, showHelp } from './ui/dialogs';
import { h, icon } from './ui/dom';
import type { IconName } from './ui/dom';
import { HealthPanel } from './ui/health';
import { MapsPanel } from './ui/maps';
import { metres, place } from './ui/numbers';
import { PicturePanel } from './ui/picture';
import { QueryBox } from './ui/query';
import { SlicePanel } from './ui/slice';
import { isDark, startTheme, switchTheme } from './ui/theme';
import { Tools } from './ui/tools';
import { Top } from './ui/top';

interface Tab {
  id: string;
  name: string;
  icon: IconName;
  element: HTMLElement;
}

/** Wide enough for a panel beside the map; what it covers there, pixels. */
const wide = window.matchMedia('(min-width: 821px)');
const SIDE = 360;
/** Where keys are letters. */
const TYPED = 'input:not([type=checkbox], [type=range]), select, textarea, dialog *';
/** How long a word is shown, ms. */
const NOTICE_MS = 3_500;

function start(): void {
  startTheme();
  const canvas = h('canvas', {
    class: 'view-canvas', tabindex: 0, role: 'img',
    'aria-label': 'The map in 3D. Arrow keys turn, plus and minus zoom, W A S D move.',
  });
  const view = h('div', { class: 'view' }, canvas);
  document.body.append(view);
  let viewer: Viewer;
  try {
    viewer = new Viewer(view, canvas);
  } catch (error) {
    view.append(h('p', { class: 'no-webgl' }, `This browser cannot draw in 3D (WebGL 2): ${said(error)}`));
    return;
  }
  isDark.watch((dark) => viewer.setDark(dark));
  build(new App(viewer), view, canvas);
}

function build(app: App, view: HTMLElement, canvas: HTMLCanvasElement): void {
  const { viewer } = app;
  const [top, tools, query] = [new Top(app), new Tools(app), new QueryBox(app)];
  const [slice, picture] = [new SlicePanel(app), new PicturePanel(app)];
  const tabs: Tab[] = [
    { id: 'health', name: 'Health', icon: 'health', element: new HealthPanel(app).element },
    { id: 'slice', name: 'Slice', icon: 'slice', element: slice.element },
    { id: 'picture', name: 'Picture', icon: 'picture', element: picture.element },
    { id: 'maps', name: 'Maps', icon: 'maps', element: new MapsPanel(app).element },
  ];
  const panel = new Panel(tabs, (open) => viewer.setCovered({ right: open && wide.matches ? SIDE : 0 }));
  const notice = h('div', { class: 'notice', role: 'status', hidden: true });
  const empty = h('div', { class: 'empty-map', hidden: true },
    h('h2', {}, 'Nothing is mapped yet'), h('p', {}, 'The room appears here as soon as a robot sends frames.'),
    h('code', {}, 'orenx stream synthetic:room'));
  new KeyDialog(app);
  view.append(tools.element, notice, empty);
  document.body.append(top.element, top.banner, panel.element, query.element);
  viewer.setCovered({ above: top.element.offsetHeight + tools.element.offsetHeight });

  let going: ReturnType<typeof setTimeout> | undefined;
  app.notice.watch((text) => {
    notice.hidden = text === '';
    notice.textContent = text;
    clearTimeout(going);
    if (text !== '') going = setTimeout(() => app.notice.set(''), NOTICE_MS);
  });
  app.connection.stats.watch((stats) => (empty.hidden = !stats || stats.map.bounds !== null));
  canvas.addEventListener('pointermove', (event) => event.buttons === 0 && slice.hoverAt(event.clientX, event.clientY));
  viewer.controls.onTap = (x, y) => pick(app, x, y);

  const actions: Record<string, () => void> = {
    '/': () => query.input.focus(),
    '?': showHelp,
    f: () => viewer.fit(),
    g: () => tools.switchMode(),
    p: () => tools.switchForm(),
    l: () => slice.setOn(!slice.isOn),
    '[': () => slice.step(-1),
    ']': () => slice.step(1),
    r: () => {
      panel.choose('picture');
      void picture.draw();
    },
    t: switchTheme,
    Escape: () => (app.found.value ? app.forget() : panel.close()),
  };
  tabs.forEach((tab, i) => (actions[String(i + 1)] = () => panel.choose(tab.id)));
  document.addEventListener('keydown', (event) => {
    const isTyping = event.target instanceof Element && event.target.matches(TYPED);
    if (isTyping || event.ctrlKey || event.metaKey || event.altKey) return;
    const action = actions[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (!action) return;
    event.preventDefault();
    action();
  });
}

/** What is there, and how far: of what is drawn, since one looks through walls from outside. */
function pick(app: App, x: number, y: number): void {
  const { origin, direction } = app.viewer.rayAt(x, y);
  const range = app.viewer.surface.pick(origin, direction);
  if (range === Infinity) return;
  const at = origin.map((o, i) => o + (direction[i] ?? 0) * range) as Triple;
  app.viewer.pointer.show(at, null, Math.max(0.4, range * 0.06));
  app.viewer.invalidate();
  app.notice.set(`${place(at)}: ${metres(range)} from the eye`);
}

/** Tabs beside the view; on a phone a sheet below it. */
class Panel {
  readonly element: HTMLElement;
  private readonly buttons: HTMLButtonElement[];
  private readonly body: HTMLElement;

  constructor(
    private readonly tabs: Tab[],
    private readonly onOpen: (open: boolean) => void,
  ) {
    this.buttons = tabs.map((tab) => h('button', {
      type: 'button', role: 'tab', id: `tab-${tab.id}`, 'aria-controls': `panel-${tab.id}`,
      onclick: () => (this.isOpen(tab.id) ? this.close() : this.choose(tab.id)),
      onkeydown: (event) => this.walk(event as KeyboardEvent),
    }, icon(tab.icon), h('span', {}, tab.name)));
    const pages = tabs.map((tab) => h('div', {
      class: 'page', role: 'tabpanel', id: `panel-${tab.id}`, 'aria-labelledby': `tab-${tab.id}`, tabindex: 0, hidden: true,
    }, tab.element));
    this.body = h('div', { class: 'panel-body' }, ...pages);
    this.element = h('aside', { class: 'panel', 'aria-label': 'Map and server' },
      h('div', { class: 'tabs', role: 'tablist' }, ...this.buttons), this.body);
    // A phone begins with the map alone.
    if (wide.matches) this.choose('health');
    else this.close();
  }

  private isOpen(id: string): boolean {
    return document.getElementById(`panel-${id}`)?.hidden === false;
  }

  choose(id: string): void {
    this.show(id);
  }

  close(): void {
    this.show(null);
  }

  private show(id: string | null): void {
    this.tabs.forEach((tab, i) => {
      const page = this.body.children[i];
      if (page instanceof HTMLElement) page.hidden = tab.id !== id;
      this.buttons[i]?.setAttribute('aria-selected', String(tab.id === id));
      this.buttons[i]?.setAttribute('tabindex', tab.id === (id ?? this.tabs[0]?.id) ? '0' : '-1');
    });
    this.body.hidden = id === null;
    document.body.classList.toggle('panel-open', id !== null);
    this.onOpen(id !== null);
    this.body.scrollTop = 0;
  }

  private walk(event: KeyboardEvent): void {
    const step = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 }[event.key];
    if (step === undefined) return;
    event.preventDefault();
    const at = this.buttons.indexOf(event.currentTarget as HTMLButtonElement);
    const next = (at + step + this.tabs.length) % this.tabs.length;
    this.choose(this.tabs[next]?.id ?? '');
    this.buttons[next]?.focus();
  }
}

start();
