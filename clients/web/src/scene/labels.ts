// Names beside the robots, as text of the page.

import type { Vector3 } from 'three';
import type { Camera } from 'three';

import { h } from '../ui/dom';
import { robotColor } from './robots';

export class Labels {
  private readonly layer = h('div', { class: 'labels', 'aria-hidden': 'true' });
  private readonly labels = new Map<string, HTMLElement>();

  constructor(host: HTMLElement) {
    host.append(this.layer);
  }

  place(robots: { id: string; place: Vector3 }[], camera: Camera, size: { width: number; height: number }): void {
    for (const [id, label] of this.labels) {
      if (!robots.some((robot) => robot.id === id)) {
        label.remove();
        this.labels.delete(id);
      }
    }
    robots.forEach(({ id, place }, index) => {
      const label = this.labels.get(id) ?? this.add(id, index);
      const at = place.clone().project(camera);
      const isSeen = at.z < 1 && Math.abs(at.x) < 1.05 && Math.abs(at.y) < 1.05;
      label.hidden = !isSeen;
      const x = (at.x * 0.5 + 0.5) * size.width;
      const y = (0.5 - at.y * 0.5) * size.height;
      label.style.transform = `translate(${x.toFixed(1)}px, ${y.toFixed(1)}px)`;
    });
  }

  private add(id: string, index: number): HTMLElement {
    const label = h('span', { class: 'label' }, id);
    label.style.setProperty('--robot', robotColor(index));
    this.labels.set(id, label);
    this.layer.append(label);
    return label;
  }
}
