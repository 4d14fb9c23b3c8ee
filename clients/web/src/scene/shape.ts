// A piece of the surface as it is drawn: its triangles, fewer of them, or its vertices as points.

import { Box3, BufferAttribute, BufferGeometry, Mesh, Points, Sphere, Vector3 } from 'three';
import type { ShaderMaterial } from 'three';

import type { Heat } from '../mesh/heat';
import type { Piece } from '../mesh/read';
import { normalsOf } from '../mesh/read';
import { simplified } from '../mesh/simpler';
import { tinted } from '../mesh/tint';

export interface Materials {
  triangles: ShaderMaterial;
  points: ShaderMaterial;
}

/** 0: every triangle; each step more is of cells twice as wide, and has about a quarter of them. */
export type Level = 0 | 1 | 2;
export type Form = 'triangles' | 'points';

export class Shape {
  readonly object: Mesh<BufferGeometry, ShaderMaterial> | Points<BufferGeometry, ShaderMaterial>;
  private readonly attributes: Record<string, BufferAttribute>;
  private readonly normals: Int8Array;
  private readonly geometries = new Map<Level | 'points', BufferGeometry>();

  constructor(
    readonly piece: Piece,
    /** Edge of the piece, and how far its vertices are apart, m. */
    private readonly sizes: { pieceM: number; resolutionM: number },
    materials: Materials,
    private readonly form: Form,
    heat: Heat | null,
  ) {
    const count = piece.places.length / 4;
    this.normals = normalsOf(piece);
    this.attributes = {
      // The fourth is the packed normal, and is not read.
      position: new BufferAttribute(piece.places, 4, true),
      normal: new BufferAttribute(this.normals, 4, true),
      tint: new BufferAttribute(tinted(piece), 4, true),
      // Four bytes a vertex: what is not aligned is slow.
      heat: new BufferAttribute(new Uint8Array(count * 4), 4, true),
    };
    this.warm(heat);
    this.object = form === 'points'
      ? new Points(this.geometry('points'), materials.points)
      : new Mesh(this.geometry(0), materials.triangles);
    this.object.position.set(...piece.key).multiplyScalar(sizes.pieceM);
    this.object.scale.setScalar(sizes.pieceM);
    this.object.updateMatrixWorld();
    this.object.matrixAutoUpdate = false;
  }

  get triangles(): number {
    return this.piece.indices.length / 3;
  }

  /** Triangles or points that it is drawn with now. */
  get drawn(): number {
    const { geometry } = this.object;
    return geometry.index ? geometry.index.count / 3 : this.piece.places.length / 4;
  }

  setLevel(level: Level): void {
    if (this.form === 'triangles') this.object.geometry = this.geometry(level);
  }

  /** Where its vertices are, m. */
  bounds(): Box3 {
    const { places, key } = this.piece;
    const [low, high] = [[65535, 65535, 65535], [0, 0, 0]];
    for (let i = 0; i < places.length; i += 1) {
      const axis = i & 3;
      if (axis === 3) continue;
      const place = places[i] ?? 0;
      low[axis] = Math.min(low[axis] ?? place, place);
      high[axis] = Math.max(high[axis] ?? place, place);
    }
    const at = (of: number[]) => new Vector3(...of.map((place, axis) => ((key[axis] ?? 0) + place / 65535) * this.sizes.pieceM));
    return new Box3(at(low), at(high));
  }

  /** Takes up how well each vertex fits. */
  warm(heat: Heat | null): void {
    const { heat: attribute } = this.attributes;
    if (!attribute) return;
    const bytes = attribute.array as Uint8Array;
    if (heat) heat.ofPiece(this.piece, this.sizes.pieceM).forEach((value, i) => (bytes[4 * i] = value));
    else bytes.fill(0);
    attribute.needsUpdate = true;
  }

  dispose(): void {
    for (const geometry of this.geometries.values()) geometry.dispose();
  }

  /** All of them are of the same vertices. */
  private geometry(level: Level | 'points'): BufferGeometry {
    const made = this.geometries.get(level);
    if (made) return made;
    const geometry = new BufferGeometry();
    for (const [name, attribute] of Object.entries(this.attributes)) geometry.setAttribute(name, attribute);
    if (level !== 'points') geometry.setIndex(new BufferAttribute(this.indices(level), 1));
    geometry.boundingSphere = new Sphere(new Vector3(0.5, 0.5, 0.5), Math.sqrt(0.75));
    this.geometries.set(level, geometry);
    return geometry;
  }

  private indices(level: Level): Uint16Array | Uint32Array {
    if (level === 0) return this.piece.indices;
    const cells = this.sizes.pieceM / this.sizes.resolutionM / 2 ** level;
    return simplified(this.piece, this.normals, Math.max(1, Math.round(cells)));
  }
}
