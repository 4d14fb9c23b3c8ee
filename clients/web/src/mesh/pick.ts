// Where a ray meets a piece: its front sides alone, as they are drawn.

import type { Triple } from '../api/types';
import type { Piece } from './read';
import { placeOf } from './read';

/** Whether a ray comes near a cube of edge `size` at all. */
function meetsCube(piece: Piece, size: number, origin: Triple, direction: Triple): boolean {
  let [near, far] = [0, Infinity];
  for (let axis = 0; axis < 3; axis += 1) {
    const low = (piece.key[axis] ?? 0) * size;
    const d = direction[axis] || 1e-12;
    const [a, b] = [(low - (origin[axis] ?? 0)) / d, (low + size - (origin[axis] ?? 0)) / d];
    near = Math.max(near, Math.min(a, b));
    far = Math.min(far, Math.max(a, b));
  }
  return near <= far;
}

/** How far along the ray the nearest front side is, in lengths of its direction; Infinity for none
 * (Möller and Trumbore, 1997). */
export function pickPiece(piece: Piece, size: number, origin: Triple, direction: Triple): number {
  let nearest = Infinity;
  if (!meetsCube(piece, size, origin, direction)) return nearest;
  const [ox, oy, oz] = origin;
  const [dx, dy, dz] = direction;
  const places = new Float32Array((piece.places.length / 4) * 3);
  const at = [0, 0, 0];
  for (let vertex = 0; vertex < piece.places.length / 4; vertex += 1) {
    placeOf(piece, vertex, size, at);
    places.set(at, 3 * vertex);
  }
  const x = (vertex: number, axis: number) => places[3 * vertex + axis] ?? 0;
  for (let i = 0; i < piece.indices.length; i += 3) {
    const [a, b, c] = [piece.indices[i] ?? 0, piece.indices[i + 1] ?? 0, piece.indices[i + 2] ?? 0];
    const [ax, ay, az] = [x(a, 0), x(a, 1), x(a, 2)];
    const [ux, uy, uz] = [x(b, 0) - ax, x(b, 1) - ay, x(b, 2) - az];
    const [vx, vy, vz] = [x(c, 0) - ax, x(c, 1) - ay, x(c, 2) - az];
    const [px, py, pz] = [dy * vz - dz * vy, dz * vx - dx * vz, dx * vy - dy * vx];
    const determinant = ux * px + uy * py + uz * pz;
    // Seen from behind, or from its edge.
    if (determinant <= 1e-12) continue;
    const [tx, ty, tz] = [ox - ax, oy - ay, oz - az];
    const u = tx * px + ty * py + tz * pz;
    if (u < 0 || u > determinant) continue;
    const [qx, qy, qz] = [ty * uz - tz * uy, tz * ux - tx * uz, tx * uy - ty * ux];
    const v = dx * qx + dy * qy + dz * qz;
    if (v < 0 || u + v > determinant) continue;
    const t = (vx * qx + vy * qy + vz * qz) / determinant;
    if (t > 0 && t < nearest) nearest = t;
  }
  return nearest;
}
