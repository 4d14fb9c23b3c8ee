// Fewer triangles of the same vertices, for a machine that draws slowly: vertices of a cell that face
// the same way are drawn as one of them (vertex clustering; Rossignac and Borrel, 1993).

import type { Piece } from './read';

/** The triangles of a piece that are left when its edge has this many cells. */
export function simplified(piece: Piece, normals: Int8Array, cells: number): Uint16Array | Uint32Array {
  const stands = representatives(piece, normals, cells);
  const { indices } = piece;
  const kept = indices.slice();
  let size = 0;
  for (let i = 0; i < indices.length; i += 3) {
    const [a, b, c] = [at(stands, at(indices, i)), at(stands, at(indices, i + 1)), at(stands, at(indices, i + 2))];
    if (a === b || b === c || c === a) continue;
    // One that was turned over would be a hole: only fronts are drawn.
    const isTurned = facing(piece, normals, a, b, c) < 0;
    kept[size] = a;
    kept[size + 1] = isTurned ? c : b;
    kept[size + 2] = isTurned ? b : c;
    size += 3;
  }
  return kept.slice(0, size);
}

/** Whether a triangle faces where its corners do: above 0 if so. */
function facing({ places }: Piece, normals: Int8Array, a: number, b: number, c: number): number {
  const side = (to: number, axis: number) => at(places, 4 * to + axis) - at(places, 4 * a + axis);
  let sum = 0;
  for (let axis = 0; axis < 3; axis += 1) {
    const [next, last] = [(axis + 1) % 3, (axis + 2) % 3];
    const across = side(b, next) * side(c, last) - side(b, last) * side(c, next);
    sum += across * (at(normals, 4 * a + axis) + at(normals, 4 * b + axis) + at(normals, 4 * c + axis));
  }
  return sum;
}

/** For each vertex the one that is drawn in its place: of its cluster the one nearest to the middle. */
function representatives(piece: Piece, normals: Int8Array, cells: number): Uint32Array {
  const count = piece.places.length / 4;
  const clusters = new Uint32Array(count);
  const names = new Map<number, number>();
  // x, y, z and how many, one after the other.
  const sums: number[] = [];
  for (let vertex = 0; vertex < count; vertex += 1) {
    const name = nameOf(piece, normals, vertex, cells);
    let cluster = names.get(name);
    if (cluster === undefined) {
      cluster = names.size;
      names.set(name, cluster);
      sums.push(0, 0, 0, 0);
    }
    clusters[vertex] = cluster;
    for (let axis = 0; axis < 3; axis += 1) {
      sums[4 * cluster + axis] = at(sums, 4 * cluster + axis) + at(piece.places, 4 * vertex + axis);
    }
    sums[4 * cluster + 3] = at(sums, 4 * cluster + 3) + 1;
  }
  const nearest = new Float64Array(names.size).fill(Infinity);
  const best = new Uint32Array(names.size);
  for (let vertex = 0; vertex < count; vertex += 1) {
    const cluster = at(clusters, vertex);
    let off = 0;
    for (let axis = 0; axis < 3; axis += 1) {
      const mean = at(sums, 4 * cluster + axis) / at(sums, 4 * cluster + 3);
      off += (at(piece.places, 4 * vertex + axis) - mean) ** 2;
    }
    const other = at(best, cluster);
    if (off > at(nearest, cluster) || (off === at(nearest, cluster) && !isBefore(piece, vertex, other))) continue;
    nearest[cluster] = off;
    best[cluster] = vertex;
  }
  return clusters.map((cluster) => at(best, cluster));
}

/** Which cluster a vertex is in. Those on a border of the piece are for themselves: the next piece has them
 * too, makes the same of them, and no gap opens between the two. */
function nameOf({ places }: Piece, normals: Int8Array, vertex: number, cells: number): number {
  let cell = 0;
  for (let axis = 0; axis < 3; axis += 1) {
    const place = at(places, 4 * vertex + axis);
    const inside = place === 65535 ? cells + 1 : 1 + Math.floor((place / 65535) * cells);
    cell = cell * (cells + 2) + (place === 0 ? 0 : inside);
  }
  // The two sides of a thin thing stay two.
  let [side, most] = [0, -1];
  for (let axis = 0; axis < 3; axis += 1) {
    const part = at(normals, 4 * vertex + axis);
    if (Math.abs(part) > most) [side, most] = [2 * axis + (part < 0 ? 1 : 0), Math.abs(part)];
  }
  return 6 * cell + side;
}

/** Of two that are equally near: every piece takes the same, whatever their order. */
function isBefore({ places }: Piece, vertex: number, other: number): boolean {
  for (let axis = 0; axis < 3; axis += 1) {
    const apart = at(places, 4 * vertex + axis) - at(places, 4 * other + axis);
    if (apart !== 0) return apart < 0;
  }
  return false;
}

/** Loops never leave their arrays; this says so. */
function at(array: ArrayLike<number>, index: number): number {
  return array[index] ?? 0;
}
