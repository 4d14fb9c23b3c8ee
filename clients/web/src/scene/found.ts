// What a text found: boxes around the matches; and a mark where one pointed.

import { Group, Quaternion, Vector3 } from 'three';
import { LineMaterial } from 'three/addons/lines/LineMaterial.js';
import { LineSegments2 } from 'three/addons/lines/LineSegments2.js';
import { LineSegmentsGeometry } from 'three/addons/lines/LineSegmentsGeometry.js';

import type { Match, Triple } from '../api/types';

export class FoundBoxes {
  readonly group = new Group();
  private readonly resolution = { width: 1, height: 1 };

  show(matches: Match[], chosen: number): void {
    this.clear();
    for (const match of matches) {
      const isChosen = match.id === chosen;
      const material = new LineMaterial({
        linewidth: isChosen ? 3 : 1.6,
        color: '#ffb454',
        transparent: true,
        opacity: isChosen ? 1 : 0.3,
        depthTest: !isChosen,
      });
      material.resolution.set(this.resolution.width, this.resolution.height);
      const box = new LineSegments2(new LineSegmentsGeometry().setPositions(EDGES), material);
      box.position.set(...match.obb.center_m);
      box.quaternion.copy(new Quaternion(...match.obb.rotation));
      // A hair outside of what it is around.
      box.scale.set(...(match.obb.half_size_m.map((half) => half + 0.03) as Triple));
      box.renderOrder = 3;
      this.group.add(box);
    }
  }

  clear(): void {
    for (const child of [...this.group.children]) {
      this.group.remove(child);
      if (child instanceof LineSegments2) {
        child.geometry.dispose();
        child.material.dispose();
      }
    }
  }

  setSize(width: number, height: number): void {
    Object.assign(this.resolution, { width, height });
    for (const child of this.group.children) {
      if (child instanceof LineSegments2) child.material.resolution.set(width, height);
    }
  }
}

/** A place, and the way in which distance grows there. */
export class Pointer {
  readonly lines: LineSegments2;

  constructor() {
    const material = new LineMaterial({ linewidth: 3, depthTest: false, transparent: true });
    material.color.set('#ffffff');
    this.lines = new LineSegments2(new LineSegmentsGeometry(), material);
    this.lines.visible = false;
    this.lines.renderOrder = 4;
    this.lines.frustumCulled = false;
  }

  show(at: Triple, gradient: Triple | null, size: number): void {
    const cross = size * 0.12;
    const lines: number[] = [];
    for (let axis = 0; axis < 3; axis += 1) {
      for (const sign of [-1, 1]) {
        lines.push(...at.map((x, i) => (i === axis ? x + sign * cross : x)));
      }
    }
    if (gradient) {
      const tip = new Vector3(...gradient).normalize().multiplyScalar(size);
      lines.push(...at, at[0] + tip.x, at[1] + tip.y, at[2] + tip.z);
    }
    this.lines.geometry.dispose();
    this.lines.geometry = new LineSegmentsGeometry().setPositions(lines);
    this.lines.visible = true;
  }

  hide(): void {
    this.lines.visible = false;
  }
}

/** The edges of a cube from -1 to 1. */
const EDGES: number[] = [];
for (let axis = 0; axis < 3; axis += 1) {
  for (let corner = 0; corner < 4; corner += 1) {
    for (const end of [-1, 1]) {
      const at = [0, 0, 0];
      at[axis] = end;
      at[(axis + 1) % 3] = (corner & 1) * 2 - 1;
      at[(axis + 2) % 3] = (corner >> 1) * 2 - 1;
      EDGES.push(...at);
    }
  }
}
