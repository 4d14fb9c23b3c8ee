// Colours for vertices that no camera saw close enough: those of their neighbours.

import type { Piece } from './read';

/** How far a colour spreads, in edges. */
const PASSES = 4;

/** The colours of a piece, without the small gaps at its rims. */
export function tinted(piece: Piece): Uint8Array {
  const count = piece.places.length / 4;
  const colors = piece.colors ? piece.colors.slice() : new Uint8Array(count * 4);
  for (let pass = 0; pass < PASSES; pass += 1) {
    const sums = new Float32Array(count * 4);
    let missing = false;
    const { indices } = piece;
    for (let i = 0; i < indices.length; i += 3) {
      for (let corner = 0; corner < 3; corner += 1) {
        const to = indices[i + corner] ?? 0;
        if (colors[4 * to + 3] !== 0) continue;
        missing = true;
        for (let other = 1; other < 3; other += 1) {
          const from = indices[i + ((corner + other) % 3)] ?? 0;
          if (colors[4 * from + 3] === 0) continue;
          for (let channel = 0; channel < 3; channel += 1) {
            sums[4 * to + channel] = (sums[4 * to + channel] ?? 0) + (colors[4 * from + channel] ?? 0);
          }
          sums[4 * to + 3] = (sums[4 * to + 3] ?? 0) + 1;
        }
      }
    }
    if (!missing) break;
    for (let vertex = 0; vertex < count; vertex += 1) {
      const weight = sums[4 * vertex + 3] ?? 0;
      if (weight === 0) continue;
      for (let channel = 0; channel < 3; channel += 1) {
        colors[4 * vertex + channel] = (sums[4 * vertex + channel] ?? 0) / weight;
      }
      colors[4 * vertex + 3] = 255;
    }
  }
  return colors;
}
