// A grid of metres under the map, that fades with distance. Lines: a plane would cost every pixel beside
// the map.

import { BufferAttribute, BufferGeometry, Color, LineSegments, ShaderMaterial } from 'three';

/** Lines to either side of the middle. */
const LINES = 24;
/** Every so many is stronger; and where a map is large, one of so many is left, again and again. */
const STRONG = 5;

export class Ground {
  readonly mesh: LineSegments<BufferGeometry, ShaderMaterial>;

  constructor() {
    const material = new ShaderMaterial({
      transparent: true,
      depthWrite: false,
      uniforms: { ink: { value: new Color(1, 1, 1) } },
      vertexShader: /* glsl */ `
        attribute float weight;
        varying float vWeight;
        void main() {
          vWeight = weight;
          gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
        }`,
      fragmentShader: /* glsl */ `
        uniform vec3 ink;
        varying float vWeight;
        void main() {
          gl_FragColor = vec4(ink, vWeight);
        }`,
    });
    this.mesh = new LineSegments(grid(), material);
    this.mesh.renderOrder = -1;
    this.mesh.frustumCulled = false;
  }

  place(x: number, y: number, z: number, reach: number): void {
    let step = 1;
    while (1.5 * reach > LINES * step) step *= STRONG;
    // In whole strong steps, so that the lines stay where they are.
    const snapped = (at: number) => step * STRONG * Math.round(at / step / STRONG);
    this.mesh.scale.setScalar(step);
    this.mesh.position.set(snapped(x), snapped(y), z);
  }

  setInk(dark: boolean): void {
    const uniform = this.mesh.material.uniforms.ink;
    if (uniform) uniform.value = dark ? new Color(0.75, 0.82, 0.95) : new Color(0.2, 0.22, 0.28);
  }
}

/** Lines in short pieces: some drivers drop one of which a part is far outside of the view. */
function grid(): BufferGeometry {
  const places: number[] = [];
  const weights: number[] = [];
  const add = (x: number, y: number, strength: number) => {
    const off = Math.hypot(x, y) / LINES;
    places.push(x, y, 0);
    weights.push(strength * Math.max(0, 1 - off * off));
  };
  for (let line = -LINES; line <= LINES; line += 1) {
    const strength = line % STRONG === 0 ? 0.26 : 0.12;
    for (let at = -LINES; at < LINES; at += 1) {
      if (Math.hypot(line, at + 0.5) > LINES) continue;
      for (const end of [at, at + 1]) add(line, end, strength);
      for (const end of [at, at + 1]) add(end, line, strength);
    }
  }
  const geometry = new BufferGeometry();
  geometry.setAttribute('position', new BufferAttribute(new Float32Array(places), 3));
  geometry.setAttribute('weight', new BufferAttribute(new Float32Array(weights), 1));
  return geometry;
}
