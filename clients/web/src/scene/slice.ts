// A horizontal slice of signed distances, drawn where it is: colours, and lines of equal distance.

import {
  DataTexture,
  DataUtils,
  DoubleSide,
  HalfFloatType,
  LinearFilter,
  Mesh,
  PlaneGeometry,
  RGFormat,
  ShaderMaterial,
} from 'three';

import type { Triple } from '../api/types';

/** Cells of a slice, x the fastest. */
export interface Slice {
  /** Low corner of the low cell, and the height. */
  origin: Triple;
  resolution: number;
  width: number;
  height: number;
  /** m; NaN where unknown. */
  distance: Float32Array;
  epoch: number;
}

const FRAGMENT = /* glsl */ `
  uniform sampler2D cells;
  varying vec2 vAt;
  varying vec2 vPlace;
  vec3 shade(float d) {
    vec3 inside = mix(vec3(0.93, 0.42, 0.36), vec3(0.56, 0.11, 0.22), smoothstep(0.0, 0.25, -d));
    vec3 near = mix(vec3(0.99, 0.87, 0.56), vec3(0.20, 0.72, 0.64), smoothstep(0.0, 0.45, d));
    vec3 free = mix(near, vec3(0.13, 0.30, 0.62), smoothstep(0.35, 1.6, d));
    return d < 0.0 ? inside : free;
  }
  float line(float at, float width) {
    float off = abs(fract(at - 0.5) - 0.5) / max(fwidth(at), 1e-6);
    return 1.0 - smoothstep(width - 0.7, width + 0.7, off);
  }
  void main() {
    vec2 cell = texture2D(cells, vAt).rg;
    float known = cell.g;
    if (known < 0.02) discard;
    float d = cell.r / known;
    vec3 color = shade(d);
    // Where distances hardly change along the slice, a line of equal distance is noise.
    float slope = smoothstep(0.12, 0.45, fwidth(d) / max(length(fwidth(vPlace)), 1e-6));
    color = mix(color, color * 0.62, line(d / 0.25, 0.8) * step(0.06, abs(d)) * slope);
    float zero = 1.0 - smoothstep(1.1, 2.2, abs(d) / max(fwidth(d), 1e-6));
    color = mix(color, vec3(1.0), zero * slope);
    gl_FragColor = vec4(color, 0.88 * smoothstep(0.3, 0.7, known));
  }
`;

export class SlicePlane {
  readonly mesh: Mesh<PlaneGeometry, ShaderMaterial>;
  private texture: DataTexture | null = null;

  constructor() {
    const material = new ShaderMaterial({
      transparent: true,
      depthWrite: false,
      side: DoubleSide,
      uniforms: { cells: { value: null } },
      vertexShader: /* glsl */ `
        varying vec2 vAt;
        varying vec2 vPlace;
        void main() {
          vAt = uv;
          vPlace = (modelMatrix * vec4(position, 1.0)).xy;
          gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
        }`,
      fragmentShader: FRAGMENT,
    });
    this.mesh = new Mesh(new PlaneGeometry(1, 1), material);
    this.mesh.visible = false;
    this.mesh.renderOrder = 2;
  }

  show(slice: Slice | null): void {
    this.mesh.visible = slice !== null;
    if (!slice) return;
    const { width, height, resolution, origin } = slice;
    this.texture?.dispose();
    this.texture = new DataTexture(packed(slice), width, height, RGFormat, HalfFloatType);
    this.texture.minFilter = LinearFilter;
    this.texture.magFilter = LinearFilter;
    this.texture.needsUpdate = true;
    const uniform = this.mesh.material.uniforms.cells;
    if (uniform) uniform.value = this.texture;
    const [wide, high] = [width * resolution, height * resolution];
    this.mesh.scale.set(wide, high, 1);
    this.mesh.position.set(origin[0] + wide / 2, origin[1] + high / 2, origin[2]);
  }
}

/** Distance and whether it is known, so that both may be smoothed. */
function packed({ distance }: Slice): Uint16Array {
  const cells = new Uint16Array(distance.length * 2);
  const one = DataUtils.toHalfFloat(1);
  distance.forEach((d, i) => {
    if (Number.isNaN(d)) return;
    cells[2 * i] = DataUtils.toHalfFloat(Math.max(-50, Math.min(50, d)));
    cells[2 * i + 1] = one;
  });
  return cells;
}

/** The distance at a place of the slice by its cells; NaN where unknown or outside. */
export function distanceAt(slice: Slice, x: number, y: number): number {
  const column = Math.floor((x - slice.origin[0]) / slice.resolution);
  const row = Math.floor((y - slice.origin[1]) / slice.resolution);
  if (column < 0 || row < 0 || column >= slice.width || row >= slice.height) return NaN;
  return slice.distance[column + row * slice.width] ?? NaN;
}

/** The same colours for a flat picture: bytes of red, green, blue. */
export function sliceColor(d: number): Triple {
  const mix = (a: Triple, b: Triple, t: number): Triple => [
    a[0] + (b[0] - a[0]) * t,
    a[1] + (b[1] - a[1]) * t,
    a[2] + (b[2] - a[2]) * t,
  ];
  const step = (low: number, high: number) => {
    const t = Math.min(1, Math.max(0, (Math.abs(d) - low) / (high - low)));
    return t * t * (3 - 2 * t);
  };
  const color =
    d < 0
      ? mix([0.93, 0.42, 0.36], [0.56, 0.11, 0.22], step(0, 0.25))
      : mix(mix([0.99, 0.87, 0.56], [0.2, 0.72, 0.64], step(0, 0.45)), [0.13, 0.3, 0.62], step(0.35, 1.6));
  return [color[0] * 255, color[1] * 255, color[2] * 255];
}
