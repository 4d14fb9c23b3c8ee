// The mesh: one geometry a piece, replaced as pieces change.

import {
  BufferAttribute,
  BufferGeometry,
  Color,
  FrontSide,
  Group,
  Mesh,
  ShaderMaterial,
  Sphere,
  Vector3,
} from 'three';

import type { Triple } from '../api/types';
import type { Heat } from '../mesh/heat';
import { pickPiece } from '../mesh/pick';
import type { Piece, Pieces } from '../mesh/read';
import { tinted } from '../mesh/tint';

export type Look = 'color' | 'normal' | 'height';
const LOOKS: Look[] = ['color', 'normal', 'height'];

const VERTEX = /* glsl */ `
  attribute vec4 tint;
  attribute float packed;
  attribute float heat;
  varying vec4 vTint;
  varying vec3 vNormal;
  varying vec3 vPlace;
  varying float vHeat;
  vec3 unfolded(float packed) {
    float both = floor(packed * 65535.0 + 0.5);
    vec2 square = vec2(mod(both, 256.0), floor(both / 256.0)) / 127.5 - 1.0;
    vec3 normal = vec3(square, 1.0 - abs(square.x) - abs(square.y));
    float below = max(-normal.z, 0.0);
    normal.x += normal.x < 0.0 ? below : -below;
    normal.y += normal.y < 0.0 ? below : -below;
    return normalize(normal);
  }
  void main() {
    vec4 world = modelMatrix * vec4(position.xyz, 1.0);
    vTint = tint;
    vHeat = heat;
    vNormal = unfolded(packed);
    vPlace = world.xyz;
    gl_Position = projectionMatrix * viewMatrix * world;
  }
`;

const FRAGMENT = /* glsl */ `
  uniform int look;
  uniform float dimmed;
  uniform vec2 heights;
  uniform vec3 plain;
  uniform vec3 hot;
  varying vec4 vTint;
  varying vec3 vNormal;
  varying vec3 vPlace;
  varying float vHeat;
  vec3 ramp(float t) {
    vec3 low = mix(vec3(0.16, 0.24, 0.50), vec3(0.10, 0.62, 0.62), smoothstep(0.0, 0.5, t));
    return mix(low, vec3(0.98, 0.82, 0.42), smoothstep(0.45, 1.0, t));
  }
  void main() {
    vec3 normal = normalize(vNormal);
    vec3 toEye = normalize(cameraPosition - vPlace);
    float sky = 0.5 + 0.5 * normal.z;
    float facing = max(dot(normal, toEye), 0.0);
    // What cameras saw has its light already; this only tells faces apart.
    float light = 0.74 + 0.16 * sky + 0.16 * facing;
    vec3 seen = mix(plain, vTint.rgb, step(0.5, vTint.a));
    if (look == 1) seen = normal * 0.5 + 0.5;
    if (look == 2) seen = ramp(clamp((vPlace.z - heights.x) / max(heights.y - heights.x, 0.01), 0.0, 1.0));
    vec3 color = seen * light;
    vec3 grey = vec3(dot(color, vec3(0.299, 0.587, 0.114)));
    color = mix(color, grey * 0.55, dimmed);
    float heat = smoothstep(0.08, 0.9, vHeat);
    // Its own pattern and its light show through.
    vec3 warm = mix(hot, vec3(1.0, 0.88, 0.55), heat * heat * 0.6) * (0.5 + 0.85 * grey) * light;
    color = mix(color, warm, dimmed * heat * 0.92);
    gl_FragColor = vec4(color, 1.0);
  }
`;

interface Shown {
  mesh: Mesh<BufferGeometry, ShaderMaterial>;
  piece: Piece;
  center: Vector3;
}

export class Surface {
  readonly group = new Group();
  private readonly shown = new Map<string, Shown>();
  private heat: Heat | null = null;
  private pieceM = 1;
  private count = 0;
  private readonly material = new ShaderMaterial({
    vertexShader: VERTEX,
    fragmentShader: FRAGMENT,
    // A wall is seen from its free side alone: from outside one looks into the room.
    side: FrontSide,
    uniforms: {
      look: { value: 0 },
      dimmed: { value: 0 },
      heights: { value: [0, 1] },
      plain: { value: new Color(0.62, 0.65, 0.7) },
      hot: { value: new Color(1, 0.56, 0.1) },
    },
  });

  get triangles(): number {
    return this.count;
  }

  get pieces(): number {
    return this.shown.size;
  }

  setLook(look: Look): void {
    this.uniform('look', LOOKS.indexOf(look));
  }

  setHeights(low: number, high: number): void {
    this.uniform('heights', [low, high]);
  }

  private uniform(name: string, value: unknown): void {
    const uniform = this.material.uniforms[name];
    if (uniform) uniform.value = value;
  }

  /** Lights up where a text fits, and dims the rest. */
  setHeat(heat: Heat | null): void {
    this.heat = heat;
    this.uniform('dimmed', heat === null ? 0 : 1);
    for (const { mesh, piece } of this.shown.values()) this.warm(mesh.geometry, piece);
  }

  take(pieces: Pieces): void {
    if (pieces.fresh) this.clear();
    this.pieceM = pieces.pieceM;
    for (const piece of pieces.pieces) this.put(piece);
  }

  clear(): void {
    for (const name of [...this.shown.keys()]) this.drop(name);
  }

  private drop(name: string): void {
    const old = this.shown.get(name);
    if (!old) return;
    this.group.remove(old.mesh);
    old.mesh.geometry.dispose();
    this.count -= old.piece.indices.length / 3;
    this.shown.delete(name);
  }

  private put(piece: Piece): void {
    const name = piece.key.join();
    this.drop(name);
    if (piece.indices.length === 0) return;
    const mesh = new Mesh(this.geometry(piece), this.material);
    const low = new Vector3(...piece.key).multiplyScalar(this.pieceM);
    mesh.position.copy(low);
    mesh.scale.setScalar(this.pieceM);
    mesh.updateMatrixWorld();
    mesh.matrixAutoUpdate = false;
    this.group.add(mesh);
    this.count += piece.indices.length / 3;
    this.shown.set(name, { mesh, piece, center: low.addScalar(this.pieceM / 2) });
  }

  private geometry(piece: Piece): BufferGeometry {
    const geometry = new BufferGeometry();
    const count = piece.places.length / 4;
    const places = new Uint16Array(count * 4);
    const packed = new Uint16Array(count * 2);
    for (let i = 0; i < count; i += 1) {
      for (let axis = 0; axis < 3; axis += 1) places[4 * i + axis] = piece.places[4 * i + axis] ?? 0;
      packed[2 * i] = piece.places[4 * i + 3] ?? 0;
    }
    geometry.setAttribute('position', new BufferAttribute(places, 4, true));
    geometry.setAttribute('packed', new BufferAttribute(packed, 2, true));
    geometry.setAttribute('tint', new BufferAttribute(tinted(piece), 4, true));
    geometry.setIndex(new BufferAttribute(piece.indices, 1));
    geometry.boundingSphere = new Sphere(new Vector3(0.5, 0.5, 0.5), Math.sqrt(0.75));
    this.warm(geometry, piece);
    return geometry;
  }

  private warm(geometry: BufferGeometry, piece: Piece): void {
    const count = piece.places.length / 4;
    const heat = new Uint8Array(count * 4);
    if (this.heat) {
      this.heat.ofPiece(piece, this.pieceM).forEach((value, i) => (heat[4 * i] = value));
    }
    // Four bytes a vertex: what is not aligned is slow.
    geometry.setAttribute('heat', new BufferAttribute(heat, 4, true));
  }

  /** How far along a ray something is drawn; Infinity where nothing is. */
  pick(origin: Triple, direction: Triple): number {
    let nearest = Infinity;
    for (const { piece } of this.shown.values()) {
      nearest = Math.min(nearest, pickPiece(piece, this.pieceM, origin, direction));
    }
    return nearest;
  }

  /** Leaves out the pieces that are farthest from the eye, but for a share of them. */
  thin(share: number, eye: Vector3): void {
    const all = [...this.shown.values()];
    if (share >= 1) {
      for (const { mesh } of all) mesh.visible = true;
      return;
    }
    all.sort((a, b) => a.center.distanceToSquared(eye) - b.center.distanceToSquared(eye));
    const kept = Math.ceil(all.length * share);
    all.forEach(({ mesh }, i) => (mesh.visible = i < kept));
  }
}
