// Health at a glance: what comes in, how soon it is seen, what is lost, what it takes.

import type { App } from '../app';
import type { MapStats, RobotReport } from '../api/types';
import { refusedFrames } from '../history';
import { robotColor } from '../scene/robots';
import { Spark } from './chart';
import { fill, h, iconButton } from './dom';
import { ago, bytes, count, milliseconds, rate, small } from './numbers';

export class HealthPanel {
  readonly element: HTMLElement;
  private readonly frames = new Spark('Frames a second', rate);
  private readonly latency = new Spark('Latency', milliseconds);
  private readonly waiting = new Spark('Waiting', count);
  private readonly memory = new Spark('Memory', bytes);
  private readonly losses = h('div', { class: 'losses' });
  private readonly lossSparks = new Map<string, Spark>();
  private readonly lossSection: HTMLElement;
  private readonly robots = h('ul', { class: 'robots' });
  private readonly lost = h('dl', { class: 'facts' });
  private readonly sizes = h('dl', { class: 'facts' });

  constructor(private readonly app: App) {
    this.lossSection = h('section', { hidden: true }, h('h3', {}, 'Training losses'), this.losses);
    this.element = h(
      'div',
      { class: 'health' },
      h('div', { class: 'sparks' }, this.frames.element, this.latency.element, this.waiting.element, this.memory.element),
      h('section', {}, h('h3', {}, 'Robots'), this.robots),
      h('section', {}, h('h3', {}, 'Frames since the server started'), this.lost),
      this.lossSection,
      h('section', {}, h('h3', {}, 'The map'), this.sizes),
    );
    app.connection.stats.watch((stats) => stats && this.draw(stats));
  }

  private draw(stats: MapStats): void {
    const { samples } = this.app.history;
    this.frames.draw(samples.map((s) => s.framesPerSecond));
    this.latency.draw(samples.map((s) => s.latencyMs));
    this.waiting.draw(samples.map((s) => s.waiting), 'frames');
    this.memory.draw(samples.map((s) => s.mapBytes), `/ ${bytes(stats.resident_bytes)}`);
    this.drawLosses(stats);
    this.drawRobots(stats.robots);
    this.drawFrames(stats);
    fill(
      this.sizes,
      ...fact('Frames', count(stats.frames)),
      ...fact('Training steps', count(stats.steps)),
      ...fact('Voxels', count(stats.voxels)),
      ...fact('Surfels', count(stats.surfels)),
      ...fact('Key frames', count(stats.key_frames)),
      ...fact('Words of its dictionary (atoms)', stats.atoms > 0 ? count(stats.atoms) : 'none yet'),
      ...(stats.voxels_refused > 0 ? fact('Refused: memory is full', count(stats.voxels_refused), 'bad') : []),
      ...fact('Epoch', count(stats.map.epoch)),
    );
  }

  private drawLosses(stats: MapStats): void {
    const names = Object.keys(stats.losses);
    this.lossSection.hidden = names.length === 0;
    for (const name of names) {
      if (!this.lossSparks.has(name)) {
        const spark = new Spark(name.replaceAll('_', ' '), small, true);
        this.lossSparks.set(name, spark);
        this.losses.append(spark.element);
      }
    }
    for (const [name, spark] of this.lossSparks) {
      spark.element.hidden = !names.includes(name);
      spark.draw(this.app.history.samples.map((sample) => sample.losses[name] ?? null));
    }
  }

  private drawFrames(stats: MapStats): void {
    const { counts } = stats;
    const words = (reason: string) => reason.toLowerCase().replaceAll('_', ' ');
    const reasons = [
      ...Object.entries(counts.dropped).map(([reason, n]) => fact(`Dropped: ${words(reason)}`, count(n), 'warn')),
      ...Object.entries(counts.rejected).map(([reason, n]) => fact(`Rejected: ${words(reason)}`, count(n), 'bad')),
      ...(counts.lost > 0 ? [fact('Lost on the way', count(counts.lost), 'warn')] : []),
    ];
    fill(
      this.lost,
      ...fact('Received', count(counts.received)),
      ...fact('In the map', count(counts.integrated)),
      ...(refusedFrames(stats) === 0 ? fact('Dropped or rejected', 'none', 'good') : reasons.flat()),
    );
  }

  private drawRobots(robots: RobotReport[]): void {
    if (robots.length === 0) {
      fill(this.robots, h('li', { class: 'empty' }, 'No robot has sent a frame since the server started.'));
      return;
    }
    // Made once and then changed: a button that is pressed must stay.
    const ids = robots.map((robot) => robot.robot_id).join('\n');
    if (this.robots.dataset.ids !== ids) {
      this.robots.dataset.ids = ids;
      fill(this.robots, ...robots.map((robot, index) => this.row(robot, index)));
    }
    robots.forEach((robot, index) => {
      const facts = this.robots.children[index]?.querySelector('.robot-facts');
      // Stamps may be of another clock, or of a recording.
      const age = Date.now() - robot.newest_stamp_ns / 1e6;
      const seen = Math.abs(age) < 3.2e10 ? `, ${ago(Math.max(age, 0))}` : '';
      if (facts) fill(facts, `${count(robot.counts.integrated)} of ${count(robot.counts.received)} frames${seen}`);
    });
  }

  private row(robot: RobotReport, index: number): HTMLElement {
    const dot = h('span', { class: 'dot', 'aria-hidden': 'true' });
    dot.style.setProperty('--robot', robotColor(index));
    const id = robot.robot_id;
    const newest = () => this.app.connection.stats.value?.robots.find((other) => other.robot_id === id);
    return h(
      'li',
      { class: 'robot' },
      dot,
      h('span', { class: 'robot-name' }, id || '(without a name)', h('span', { class: 'robot-facts' })),
      iconButton('robot', `Follow ${id}`, () => this.app.viewer.follow(id)),
      iconButton('eye', `See what ${id} sees`, () => {
        const pose = newest()?.world_from_camera;
        if (pose) this.app.viewer.standAt(pose, null);
      }),
    );
  }
}

export function fact(name: string, value: string, kind = ''): HTMLElement[] {
  return [h('dt', {}, name), h('dd', { class: kind }, value)];
}
