import { describe, expect, it } from 'vitest';

import { normalsOf, placeOf, readPieces } from '../../src/mesh/read';

/** An answer with one piece: a triangle, coloured or not, with indices of either width. */
function answer({ colored = true, wide = false, index = 2, fresh = true } = {}): ArrayBuffer {
  const bytes = 48 + 24 + 3 * 8 + (colored ? 12 : 0) + (wide ? 12 : 6 + 2);
  const view = new DataView(new ArrayBuffer(bytes));
  [0x3150584f, 1].forEach((word, i) => view.setUint32(4 * i, word, true));
  [1_700_000_000_000_123n, 9n, 5n].forEach((long, i) => view.setBigUint64(8 + 8 * i, long, true));
  view.setFloat32(32, 1.5, true);
  view.setFloat32(36, 0.05, true);
  view.setUint32(40, (fresh ? 1 : 0) | 2, true);
  [-2, 0, 1].forEach((key, i) => view.setInt32(48 + 4 * i, key, true));
  [3, 1, (colored ? 1 : 0) | (wide ? 2 : 0)].forEach((word, i) => view.setUint32(60 + 4 * i, word, true));
  let at = 72;
  for (let vertex = 0; vertex < 3; vertex += 1) {
    for (const place of [65535 * (vertex % 2), 0, 32768, 0x8080]) {
      view.setUint16(at, place, true);
      at += 2;
    }
  }
  for (let i = 0; colored && i < 12; i += 1) view.setUint8(at++, i);
  [0, 1, index].forEach((corner, i) => (wide ? view.setUint32(at + 4 * i, corner, true) : view.setUint16(at + 2 * i, corner, true)));
  return view.buffer;
}

describe('the answer with pieces', () => {
  it('has its numbers where the document says', () => {
    const { pieces, ...head } = readPieces(answer());
    expect(head).toEqual({
      generation: 1_700_000_000_000_123, next: 9, epoch: 5, pieceM: 1.5,
      resolutionM: Math.fround(0.05), fresh: true, more: true,
    });
    const [piece] = pieces;
    expect(piece?.key).toEqual([-2, 0, 1]);
    expect([...(piece?.indices ?? [])]).toEqual([0, 1, 2]);
    expect(piece?.colors?.[11]).toBe(11);
    const place = [0, 0, 0];
    if (piece) placeOf(piece, 1, 1.5, place);
    expect(place[0]).toBeCloseTo(-1.5, 6);
    expect(place[2]).toBeCloseTo(2.25, 4);
  });

  it('has normals in two bytes', () => {
    // Folded: up, along x, and down to one side.
    const packed = [[127.5, 127.5], [255, 127.5], [255, 191]].map(([x = 0, y = 0]) => Math.round(x) + 256 * Math.round(y));
    const places = new Uint16Array(packed.flatMap((both) => [0, 0, 0, both]));
    const normals = normalsOf({ key: [0, 0, 0], places, colors: null, indices: new Uint16Array() });
    expect([...normals.slice(0, 4)]).toEqual([1, 1, 127, 0]);
    expect(normals[4]).toBeGreaterThan(125);
    expect(Math.hypot(...normals.slice(8, 11))).toBeCloseTo(127, -0.5);
    expect(normals[10]).toBeLessThan(-60);
  });

  it('may have wide indices and no colours', () => {
    const [piece] = readPieces(answer({ colored: false, wide: true })).pieces;
    expect(piece?.colors).toBeNull();
    expect(piece?.indices).toBeInstanceOf(Uint32Array);
    expect(readPieces(answer({ fresh: false })).fresh).toBe(false);
  });

  it('is refused where it is cut, foreign or refers to nothing', () => {
    const whole = answer();
    for (let length = 0; length < whole.byteLength - 2; length += 1) {
      expect(() => readPieces(whole.slice(0, length)), `${length} bytes`).toThrow();
    }
    expect(() => readPieces(answer({ index: 3 }))).toThrow(/no vertex/);
    expect(() => readPieces(new ArrayBuffer(64))).toThrow(/no answer/);
  });
});
