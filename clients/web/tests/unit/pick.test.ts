import { describe, expect, it } from 'vitest';

import { pickPiece } from '../../src/mesh/pick';

describe('a ray', () => {
  // A triangle at half the height of the cube from (2, 0, 0), seen from above.
  const place = (x: number, y: number) => [x * 65535, y * 65535, 32768, 0];
  const piece = {
    key: [1, 0, 0] as [number, number, number],
    places: new Uint16Array([...place(0, 0), ...place(1, 0), ...place(0, 1)]),
    colors: null,
    indices: new Uint16Array([0, 1, 2]),
  };

  it('meets a front side, where it is', () => {
    expect(pickPiece(piece, 2, [2.5, 0.5, 5], [0, 0, -1])).toBeCloseTo(4, 3);
    expect(pickPiece(piece, 2, [2.5, 0.5, 5], [0, 0, -2])).toBeCloseTo(2, 3);
  });

  it('goes through what it sees from behind, and past what is beside it', () => {
    expect(pickPiece(piece, 2, [2.5, 0.5, -5], [0, 0, 1])).toBe(Infinity);
    expect(pickPiece(piece, 2, [3.8, 1.8, 5], [0, 0, -1])).toBe(Infinity);
    expect(pickPiece(piece, 2, [9, 9, 5], [0, 0, -1])).toBe(Infinity);
    expect(pickPiece(piece, 2, [2.5, 0.5, 0.5], [0, 0, -1])).toBe(Infinity);
  });
});
