// Elements without markup: text stays text.

type Child = Node | string | null | undefined | false;
type Handler = (event: Event) => void;
type Attributes = Record<string, string | number | boolean | Handler | null | undefined>;

/** An element with attributes, listeners (`onclick`) and children. */
export function h<K extends keyof HTMLElementTagNameMap>(
  tag: K,
  attributes: Attributes = {},
  ...children: Child[]
): HTMLElementTagNameMap[K] {
  const element = document.createElement(tag);
  apply(element, attributes);
  element.append(...children.filter(isThere));
  return element;
}

const SVG = 'http://www.w3.org/2000/svg';

export function svg(tag: string, attributes: Attributes = {}, ...children: Child[]): SVGElement {
  const element = document.createElementNS(SVG, tag);
  apply(element, attributes);
  element.append(...children.filter(isThere));
  return element;
}

function apply(element: Element, attributes: Attributes): void {
  for (const [name, value] of Object.entries(attributes)) {
    if (typeof value === 'function') element.addEventListener(name.replace(/^on/, ''), value);
    else if (value === true) element.setAttribute(name, '');
    else if (value !== false && value !== null && value !== undefined) element.setAttribute(name, String(value));
  }
}

function isThere(child: Child): child is Node | string {
  return child !== null && child !== undefined && child !== false;
}

/** Replaces what an element holds. */
export function fill(element: Element, ...children: Child[]): void {
  element.replaceChildren(...children.filter(isThere));
}

/** Paths of icons on a field of 24. */
const ICONS = {
  health: 'M3 12h4l2.5-6 4.5 12 2.5-6H21',
  slice: 'M12 4 21 9l-9 5-9-5zM3 14.500l9 5 9-5',
  picture: 'M4 7h3.500L9 5h6l1.5 2H20v12H4zM12 9.500a3.5 3.5 0 1 0 0 7 3.5 3.5 0 0 0 0-7z',
  maps: 'M4 6.5 9.5 4l5 2.500L20 4v13.500L14.5 20l-5-2.500L4 20zM9.5 4v13.500M14.5 6.500V20',
  search: 'M10.5 4a6.5 6.5 0 1 0 0 13 6.5 6.5 0 0 0 0-13zM15.5 15.5 21 21',
  theme: 'M12 3.500a8.5 8.5 0 1 0 0 17zM12 3.500a8.5 8.5 0 0 1 0 17',
  help: 'M9 9.200a3 3 0 1 1 4.4 2.700c-.9.5-1.4 1.1-1.4 2.100M12 17.300v.2M12 3a9 9 0 1 0 0 18 9 9 0 0 0 0-18z',
  fit: 'M4 9V4h5M15 4h5v5M20 15v5h-5M9 20H4v-5',
  fly: 'M3 12l18-8-6 17-3.5-6.500z',
  orbit: 'M12 9.500a2.5 2.5 0 1 0 0 5 2.5 2.5 0 0 0 0-5zM12 3a9 9 0 1 0 9 9M21 5v5h-5',
  close: 'M6 6l12 12M18 6 6 18',
  robot: 'M6 9h12v9H6zM12 9V5M9.5 13h.1M14.5 13h.1M3.5 12v3M20.5 12v3',
  key: 'M8.5 11a4 4 0 1 0 0 8 4 4 0 0 0 0-8zM11.500 12.200 20 3.700M16.500 7.200l2.700 2.700',
  points: 'M6 6.500h.1M12 5h.1M18 6.500h.1M5 12h.1M12 12h.1M19 12h.1M6 17.500h.1M12 19h.1M18 17.500h.1',
  go: 'M5 12h13M13 6.500l5.5 5.5-5.5 5.5',
  eye: 'M2.5 12s3.5-6.5 9.5-6.5 9.5 6.5 9.5 6.5-3.5 6.5-9.5 6.500S2.5 12 2.5 12zM12 9.200a2.8 2.8 0 1 0 0 5.6 2.8 2.8 0 0 0 0-5.600z',
  down: 'M12 4v11M7 10.500l5 5 5-5M5 20h14',
  trash: 'M4 7h16M9 7V4.500h6V7M6.5 7l1 13h9l1-13',
  reset: 'M4.5 12a7.5 7.5 0 1 0 2.2-5.300L4 9.300M4 4.500v4.800h4.8',
  plus: 'M12 5v14M5 12h14',
};

export type IconName = keyof typeof ICONS;

export function icon(name: IconName): SVGElement {
  return svg('svg', { class: 'icon', viewBox: '0 0 24 24', 'aria-hidden': 'true' }, svg('path', { d: ICONS[name] }));
}

/** A button with an icon alone; its name is told to those who do not see it. */
export function iconButton(name: IconName, label: string, onclick: Handler, extra: Attributes = {}): HTMLButtonElement {
  return h('button', { type: 'button', class: 'icon-button', 'aria-label': label, title: label, onclick, ...extra }, icon(name));
}
