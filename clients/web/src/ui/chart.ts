// Small charts: a line over the last minutes, with its newest value beside it.

import { fill, h, svg } from './dom';

const WIDE = 120;
const HIGH = 32;

export class Spark {
  readonly element: HTMLElement;
  private readonly value = h('span', { class: 'spark-value' }, '–');
  private readonly line = svg('path', { class: 'spark-line' });
  private readonly area = svg('path', { class: 'spark-area' });
  private readonly note = h('span', { class: 'spark-note' });

  constructor(
    name: string,
    private readonly show: (value: number) => string,
    /** In one line of a list. */
    isSmall = false,
  ) {
    const plot = svg(
      'svg',
      { viewBox: `0 0 ${WIDE} ${HIGH}`, preserveAspectRatio: 'none', class: 'spark-plot', 'aria-hidden': 'true' },
      this.area,
      this.line,
    );
    this.element = h(
      'div',
      { class: isSmall ? 'spark small' : 'spark' },
      h('span', { class: 'spark-name' }, name),
      h('span', { class: 'spark-number' }, this.value, this.note),
      plot,
    );
  }

  /** Of values that are null nothing is drawn. */
  draw(values: (number | null)[], note = ''): void {
    const known = values.filter((value) => value !== null);
    const newest = known.at(-1);
    fill(this.value, newest === undefined ? '–' : this.show(newest));
    fill(this.note, note);
    if (known.length < 2) {
      this.line.setAttribute('d', '');
      this.area.setAttribute('d', '');
      return;
    }
    const high = known.reduce((a, b) => Math.max(a, b), 0);
    const low = known.reduce((a, b) => Math.min(a, b), 0);
    const span = Math.max(high - low, 1e-9);
    const points: string[] = [];
    values.forEach((value, i) => {
      if (value === null) return;
      const x = (i / Math.max(values.length - 1, 1)) * WIDE;
      const y = HIGH - 2 - ((value - low) / span) * (HIGH - 4);
      points.push(`${x.toFixed(1)} ${y.toFixed(1)}`);
    });
    const line = `M${points.join('L')}`;
    const [first, last] = [points[0]?.split(' ')[0] ?? '0', points.at(-1)?.split(' ')[0] ?? '0'];
    this.line.setAttribute('d', line);
    this.area.setAttribute('d', `${line}L${last} ${HIGH}L${first} ${HIGH}Z`);
  }
}
