// Where a text fits, as a field that any vertex can be looked up in.

import type { Triple } from '../api/types';
import type { Piece } from './read';
import { placeOf } from './read';

/** Coldest place that counts, so that it is told from what does not count. */
const LEAST = 0.3;

export class Heat {
  private readonly scores = new Map<string, number>();
  private readonly spacing: number;

  constructor(places: Triple[], scores: number[]) {
    this.spacing = spacingOf(places);
    const low = scores.reduce((a, b) => Math.min(a, b), Infinity);
    const high = scores.reduce((a, b) => Math.max(a, b), -Infinity);
    const span = Math.max(high - low, 1e-6);
    places.forEach((place, i) => {
      const share = ((scores[i] ?? low) - low) / span;
      this.scores.set(this.cell(place), LEAST + (1 - LEAST) * share);
    });
  }

  get size(): number {
    return this.scores.size;
  }

  private cell(place: ArrayLike<number>): string {
    return [0, 1, 2].map((axis) => Math.round((place[axis] ?? 0) / this.spacing)).join();
  }

  /** Between 0, where nothing counts, and 1. */
  at(point: ArrayLike<number>): number {
    const low: number[] = [];
    const part: number[] = [];
    for (let axis = 0; axis < 3; axis += 1) {
      const at = (point[axis] ?? 0) / this.spacing;
      low.push(Math.floor(at));
      part.push(at - Math.floor(at));
    }
    let heat = 0;
    for (let corner = 0; corner < 8; corner += 1) {
      let weight = 1;
      const at: number[] = [];
      for (let axis = 0; axis < 3; axis += 1) {
        const bit = (corner >> axis) & 1;
        const share = part[axis] ?? 0;
        weight *= bit === 1 ? share : 1 - share;
        at.push((low[axis] ?? 0) + bit);
      }
      heat += weight * (this.scores.get(at.join()) ?? 0);
    }
    return Math.min(1, heat);
  }

  /** A byte for each vertex of a piece. */
  ofPiece(piece: Piece, pieceM: number): Uint8Array {
    const count = piece.places.length / 4;
    const heat = new Uint8Array(count);
    const place = [0, 0, 0];
    for (let vertex = 0; vertex < count; vertex += 1) {
      placeOf(piece, vertex, pieceM, place);
      heat[vertex] = Math.round(255 * this.at(place));
    }
    return heat;
  }
}

/** The least distance between two places along an axis: they stand on a lattice. */
function spacingOf(places: Triple[]): number {
  let least = Infinity;
  for (let axis = 0; axis < 3; axis += 1) {
    const all = places.map((place) => place[axis] ?? 0).sort((a, b) => a - b);
    for (let i = 1; i < all.length; i += 1) {
      const step = (all[i] ?? 0) - (all[i - 1] ?? 0);
      if (step > 1e-3) least = Math.min(least, step);
    }
  }
  return Number.isFinite(least) ? least : 0.1;
}
