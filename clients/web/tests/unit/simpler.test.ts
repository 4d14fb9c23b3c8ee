import { describe, expect, it } from 'vitest';

import type { Piece } from '../../src/mesh/read';
import { simplified } from '../../src/mesh/simpler';

const SIDE = 17;

/** A plate across a whole piece at some heights, its corners on a lattice; the second one faces down. */
function plates(...heights: number[]): { piece: Piece; normals: Int8Array } {
  const places: number[] = [];
  const normals: number[] = [];
  const indices: number[] = [];
  heights.forEach((height, plate) => {
    const first = places.length / 4;
    for (let y = 0; y < SIDE; y += 1) {
      for (let x = 0; x < SIDE; x += 1) {
        places.push(...[x, y].map((at) => Math.round((65535 * at) / (SIDE - 1))), height, 0);
        normals.push(0, 0, plate === 0 ? 127 : -127, 0);
        if (x + 1 === SIDE || y + 1 === SIDE) continue;
        const corner = first + x + y * SIDE;
        indices.push(corner, corner + 1, corner + SIDE, corner + 1, corner + SIDE + 1, corner + SIDE);
      }
    }
  });
  const piece: Piece = { key: [0, 0, 0], places: new Uint16Array(places), colors: null, indices: new Uint16Array(indices) };
  return { piece, normals: new Int8Array(normals) };
}

/** Area of triangles from above, of a piece whose edge is 1. */
function area({ places }: Piece, indices: ArrayLike<number>): number {
  let sum = 0;
  const at = (i: number, axis: number) => (places[4 * (indices[i] ?? 0) + axis] ?? 0) / 65535;
  for (let i = 0; i < indices.length; i += 3) {
    const [ux, uy] = [at(i + 1, 0) - at(i, 0), at(i + 1, 1) - at(i, 1)];
    const [vx, vy] = [at(i + 2, 0) - at(i, 0), at(i + 2, 1) - at(i, 1)];
    sum += (ux * vy - uy * vx) / 2;
  }
  return sum;
}

describe('fewer triangles', () => {
  it('cover what all of them cover', () => {
    const { piece, normals } = plates(30_000);
    const [half, quarter] = [simplified(piece, normals, 8), simplified(piece, normals, 4)];
    expect(half.length).toBeLessThan(0.5 * piece.indices.length);
    expect(quarter.length).toBeLessThan(0.4 * piece.indices.length);
    for (const indices of [piece.indices, half, quarter]) expect(area(piece, indices)).toBeCloseTo(1, 6);
    expect(half).toBeInstanceOf(Uint16Array);
  });

  it('have the same corners on a border as those of the next piece, which comes in another order', () => {
    const { piece, normals } = plates(30_000);
    // The same from its last vertex to its first.
    const last = SIDE * SIDE - 1;
    const turned: Piece = {
      ...piece,
      places: piece.places.map((_, i, all) => all[4 * (last - (i >> 2)) + (i & 3)] ?? 0),
      indices: piece.indices.map((index) => last - index),
    };
    const corners = (of: Piece, x: number) => {
      const kept = [...simplified(of, normals, 5)].filter((vertex) => of.places[4 * vertex] === x);
      return [...new Set(kept.map((vertex) => of.places[4 * vertex + 1]))].sort();
    };
    expect(corners(piece, 65535)).toEqual(corners(turned, 0));
    expect(corners(piece, 65535).length).toBe(7);
  });

  it('face where all of them do', () => {
    const { piece, normals } = plates(30_000);
    // Corners here and there, so that some triangles of few would be turned over.
    const places = piece.places.map((place, i) => {
      const isInside = place > 0 && place < 65535 && (i & 3) < 2;
      return isInside ? place + Math.round(3000 * Math.sin(i * 12.9898)) : place;
    });
    const rough: Piece = { ...piece, places };
    for (const cells of [3, 4, 5, 6]) {
      const indices = simplified(rough, normals, cells);
      for (let i = 0; i < indices.length; i += 3) {
        expect(area(rough, indices.slice(i, i + 3))).toBeGreaterThanOrEqual(0);
      }
    }
  });

  it('do not mix the two sides of a thin thing', () => {
    const { piece, normals } = plates(30_000, 30_100);
    const one = SIDE * SIDE;
    const indices = simplified(piece, normals, 4);
    for (let i = 0; i < indices.length; i += 3) {
      const sides = [0, 1, 2].map((corner) => (indices[i + corner] ?? 0) < one);
      expect(new Set(sides).size).toBe(1);
    }
    expect(area(piece, indices.filter((index) => index < one))).toBeCloseTo(1, 6);
  });
});
