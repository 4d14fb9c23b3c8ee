// A grid of metres under the map, that fades with distance.

import { Color, DoubleSide, Mesh, PlaneGeometry, ShaderMaterial } from 'three';

const SIDE_M = 400;

export class Ground {
  readonly mesh: Mesh<PlaneGeometry, ShaderMaterial>;

  constructor() {
    const material = new ShaderMaterial({
      transparent: true,
      depthWrite: false,
      side: DoubleSide,
      uniforms: { ink: { value: new Color(1, 1, 1) }, reach: { value: 20 } },
      vertexShader: /* glsl */ `
        varying vec3 vPlace;
        void main() {
          vec4 world = modelMatrix * vec4(position, 1.0);
          vPlace = world.xyz;
          gl_Position = projectionMatrix * viewMatrix * world;
        }`,
      fragmentShader: /* glsl */ `
        uniform vec3 ink;
        uniform float reach;
        varying vec3 vPlace;
        float lines(vec2 at, float width) {
          vec2 step = fwidth(at);
          vec2 off = abs(fract(at - 0.5) - 0.5) / max(step, 1e-6);
          float line = 1.0 - min(min(off.x, off.y) / width, 1.0);
          return line * (1.0 - smoothstep(0.25, 0.6, max(step.x, step.y)));
        }
        void main() {
          float far = 1.0 - smoothstep(0.2, 1.0, distance(vPlace, cameraPosition) / (reach * 3.0));
          float seen = max(lines(vPlace.xy, 1.1) * 0.16, lines(vPlace.xy / 5.0, 1.4) * 0.3);
          gl_FragColor = vec4(ink, seen * far);
        }`,
    });
    this.mesh = new Mesh(new PlaneGeometry(SIDE_M, SIDE_M), material);
    this.mesh.renderOrder = -1;
  }

  place(x: number, y: number, z: number, reach: number): void {
    // In whole metres, so that the lines stay where they are.
    this.mesh.position.set(Math.round(x), Math.round(y), z);
    const uniform = this.mesh.material.uniforms.reach;
    if (uniform) uniform.value = reach;
  }

  setInk(dark: boolean): void {
    const uniform = this.mesh.material.uniforms.ink;
    if (uniform) uniform.value = dark ? new Color(0.75, 0.82, 0.95) : new Color(0.2, 0.22, 0.28);
  }
}
