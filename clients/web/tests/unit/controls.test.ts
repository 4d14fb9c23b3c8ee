import { PerspectiveCamera, Vector3 } from 'three';
import { describe, expect, it } from 'vitest';

import { distanceToSee } from '../../src/scene/controls';

describe('the distance of an overview', () => {
  it('has all of a box in view, and is no farther than that', () => {
    const [min, max] = [new Vector3(-3, -2, 0), new Vector3(5, 4, 2.5)];
    const [wide, steep] = [0.6, 0.45];
    for (const from of [{ yaw: 2.25, pitch: -0.78 }, { yaw: -1, pitch: -0.2 }, { yaw: 0, pitch: -1.5 }]) {
      const distance = distanceToSee(min, max, from, wide, steep);
      const camera = new PerspectiveCamera((360 / Math.PI) * Math.atan(steep), wide / steep, 0.1, 100);
      camera.up.set(0, 0, 1);
      const middle = min.clone().add(max).multiplyScalar(0.5);
      const { yaw, pitch } = from;
      const ahead = new Vector3(Math.cos(pitch) * Math.cos(yaw), Math.cos(pitch) * Math.sin(yaw), Math.sin(pitch));
      camera.position.copy(middle).addScaledVector(ahead, -distance);
      camera.lookAt(middle);
      camera.updateMatrixWorld();
      let most = 0;
      for (let corner = 0; corner < 8; corner += 1) {
        const at = new Vector3(corner & 1 ? max.x : min.x, corner & 2 ? max.y : min.y, corner & 4 ? max.z : min.z);
        const seen = at.project(camera);
        most = Math.max(most, Math.abs(seen.x), Math.abs(seen.y));
      }
      expect(most).toBeCloseTo(1, 6);
    }
  });
});
