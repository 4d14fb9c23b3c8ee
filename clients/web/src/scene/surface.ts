// The surface of the map: pieces, replaced as they change.

import { Box3, Color, FrontSide, Group, ShaderMaterial } from 'three';

import type { Triple } from '../api/types';
import type { Heat } from '../mesh/heat';
import { pickPiece } from '../mesh/pick';
import type { Piece, Pieces } from '../mesh/read';
import type { Form, Level, Materials } from './shape';
import { Shape } from './shape';

export type Look = 'color' | 'normal' | 'height';
const LOOKS: Look[] = ['color', 'normal', 'height'];

// Vertices are close together: light and colour are worked out there, and pixels have next to nothing to
// do. A machine that draws in software feels each number that goes from one to the other.
const VERTEX = /* glsl */ `
  attribute vec4 tint;
  attribute float heat;
  uniform int look;
  uniform float dimmed;
  uniform vec2 heights;
  uniform vec3 plain;
  uniform vec3 hot;
  #ifdef POINTS
    // Distance between vertices, m, and pixels of a metre at a metre's distance.
    uniform float spacing;
    uniform float scale;
  #endif
  varying vec3 vColor;
  vec3 ramp(float t) {
    vec3 low = mix(vec3(0.16, 0.24, 0.50), vec3(0.10, 0.62, 0.62), smoothstep(0.0, 0.5, t));
    return mix(low, vec3(0.98, 0.82, 0.42), smoothstep(0.45, 1.0, t));
  }
  void main() {
    vec4 world = modelMatrix * vec4(position.xyz, 1.0);
    gl_Position = projectionMatrix * viewMatrix * world;
    float facing = max(dot(normal, normalize(cameraPosition - world.xyz)), 0.0);
    // What cameras saw has its light already; this only tells faces apart.
    float light = 0.82 + 0.08 * normal.z + 0.16 * facing;
    vec3 seen = mix(plain, tint.rgb, step(0.5, tint.a));
    if (look == 1) seen = normal * 0.5 + 0.5;
    if (look == 2) seen = ramp(clamp((world.z - heights.x) / max(heights.y - heights.x, 0.01), 0.0, 1.0));
    vColor = seen * light;
    if (dimmed > 0.0) {
      vec3 grey = vec3(dot(vColor, vec3(0.299, 0.587, 0.114)));
      float share = smoothstep(0.08, 0.9, heat);
      // Its own pattern and its light show through.
      vec3 warm = mix(hot, vec3(1.0, 0.88, 0.55), share * share * 0.6) * (0.5 + 0.85 * grey) * light;
      vColor = mix(mix(vColor, grey * 0.55, dimmed), warm, dimmed * share * 0.92);
    }
    #ifdef POINTS
      // Wide enough to touch, and seen from the front alone, as triangles are.
      gl_PointSize = clamp(1.3 * spacing * scale / gl_Position.w, 1.0, 40.0);
      if (facing == 0.0) gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
    #endif
  }
`;

const FRAGMENT = /* glsl */ `
  varying vec3 vColor;
  void main() {
    gl_FragColor = vec4(vColor, 1.0);
  }
`;

export class Surface {
  readonly group = new Group();
  private readonly shapes = new Map<string, Shape>();
  private readonly boxes = new Map<string, Box3>();
  private heat: Heat | null = null;
  private sizes = { pieceM: 1, resolutionM: 0.1 };
  private count = 0;
  private level: Level = 0;
  private form: Form = 'triangles';
  /** Both materials have the same. */
  private readonly uniforms = {
    look: { value: 0 },
    dimmed: { value: 0 },
    heights: { value: [0, 1] },
    plain: { value: new Color(0.62, 0.65, 0.7) },
    hot: { value: new Color(1, 0.56, 0.1) },
    spacing: { value: 0.1 },
    scale: { value: 500 },
  };
  private readonly materials: Materials = { triangles: this.material({}), points: this.material({ POINTS: true }) };

  private material(defines: Record<string, boolean>): ShaderMaterial {
    const material = new ShaderMaterial({
      vertexShader: VERTEX,
      fragmentShader: FRAGMENT,
      // A wall is seen from its free side alone: from outside one looks into the room.
      side: FrontSide,
      defines,
    });
    // Assigned afterwards: they are to be the same objects, and options would be copied.
    material.uniforms = this.uniforms;
    return material;
  }

  get triangles(): number {
    return this.count;
  }

  /** Where there is surface; null where there is none. */
  bounds(): Box3 | null {
    const all = new Box3();
    for (const box of this.boxes.values()) all.union(box);
    return all.isEmpty() ? null : all;
  }

  /** Triangles or points that are drawn now. */
  get drawn(): number {
    let drawn = 0;
    for (const shape of this.shapes.values()) drawn += shape.drawn;
    return drawn;
  }

  get isPoints(): boolean {
    return this.form === 'points';
  }

  setLook(look: Look): void {
    this.uniforms.look.value = LOOKS.indexOf(look);
  }

  /** Pixels of what is a metre wide and a metre away. */
  setScale(pixels: number): void {
    this.uniforms.scale.value = pixels;
  }

  setForm(form: Form): void {
    if (form === this.form) return;
    this.form = form;
    for (const { piece } of [...this.shapes.values()]) this.put(piece);
  }

  /** How many of the triangles are drawn. */
  setLevel(level: Level): void {
    if (level === this.level) return;
    this.level = level;
    for (const shape of this.shapes.values()) shape.setLevel(level);
  }

  /** Lights up where a text fits, and dims the rest. */
  setHeat(heat: Heat | null): void {
    if (heat === null && this.heat === null) return;
    this.heat = heat;
    this.uniforms.dimmed.value = heat === null ? 0 : 1;
    for (const shape of this.shapes.values()) shape.warm(heat);
  }

  take({ fresh, pieceM, resolutionM, pieces }: Pieces): void {
    if (fresh) this.clear();
    this.sizes = { pieceM, resolutionM };
    this.uniforms.spacing.value = resolutionM;
    for (const piece of pieces) this.put(piece);
    const bounds = this.bounds();
    if (bounds) this.uniforms.heights.value = [bounds.min.z, bounds.max.z];
  }

  clear(): void {
    for (const name of [...this.shapes.keys()]) this.drop(name);
  }

  private drop(name: string): void {
    const old = this.shapes.get(name);
    if (!old) return;
    this.group.remove(old.object);
    old.dispose();
    this.count -= old.triangles;
    this.shapes.delete(name);
    this.boxes.delete(name);
  }

  private put(piece: Piece): void {
    const name = piece.key.join();
    this.drop(name);
    if (piece.indices.length === 0) return;
    const shape = new Shape(piece, this.sizes, this.materials, this.form, this.heat);
    shape.setLevel(this.level);
    this.group.add(shape.object);
    this.count += shape.triangles;
    this.shapes.set(name, shape);
    this.boxes.set(name, shape.bounds());
  }

  /** How far along a ray something is drawn; Infinity where nothing is. */
  pick(origin: Triple, direction: Triple): number {
    let nearest = Infinity;
    for (const { piece } of this.shapes.values()) {
      nearest = Math.min(nearest, pickPiece(piece, this.sizes.pieceM, origin, direction));
    }
    return nearest;
  }
}
