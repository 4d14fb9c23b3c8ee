// The binary answer of `mesh/pieces`, as the server's document describes it.

export type Key = [number, number, number];

export interface Piece {
  key: Key;
  /** Four a vertex: place in the piece, and two bytes of a normal. */
  places: Uint16Array;
  /** Four a vertex: sRGB, and whether it is known; null for a piece without. */
  colors: Uint8Array | null;
  indices: Uint16Array | Uint32Array;
}

export interface Pieces {
  generation: number;
  next: number;
  epoch: number;
  /** Edge of a piece, m. */
  pieceM: number;
  /** Distance between vertices, m. */
  resolutionM: number;
  /** What was told before is void. */
  fresh: boolean;
  more: boolean;
  pieces: Piece[];
}

const MAGIC = 0x3150584f; // OXP1
const HEAD = 48;
const PIECE_HEAD = 24;
const HAS_COLORS = 1;
const WIDE = 2;

export function readPieces(buffer: ArrayBuffer): Pieces {
  const view = new DataView(buffer);
  if (buffer.byteLength < HEAD || view.getUint32(0, true) !== MAGIC) {
    throw new Error('this is no answer with pieces of a mesh');
  }
  const flags = view.getUint32(40, true);
  const answer: Pieces = {
    generation: Number(view.getBigUint64(8, true)),
    next: Number(view.getBigUint64(16, true)),
    epoch: Number(view.getBigUint64(24, true)),
    pieceM: view.getFloat32(32, true),
    resolutionM: view.getFloat32(36, true),
    fresh: (flags & 1) !== 0,
    more: (flags & 2) !== 0,
    pieces: [],
  };
  let at = HEAD;
  for (let left = view.getUint32(4, true); left > 0; left -= 1) {
    const [piece, end] = readPiece(buffer, view, at);
    answer.pieces.push(piece);
    at = end;
  }
  return answer;
}

function readPiece(buffer: ArrayBuffer, view: DataView, at: number): [Piece, number] {
  if (at + PIECE_HEAD > buffer.byteLength) throw cut();
  const key: Key = [view.getInt32(at, true), view.getInt32(at + 4, true), view.getInt32(at + 8, true)];
  const vertices = view.getUint32(at + 12, true);
  const triangles = view.getUint32(at + 16, true);
  const flags = view.getUint32(at + 20, true);
  let next = at + PIECE_HEAD;
  const take = (bytes: number): ArrayBuffer => {
    const end = next + bytes;
    if (end > buffer.byteLength) throw cut();
    // Of its own: a piece that stays must not keep the others of its answer.
    const part = buffer.slice(next, end);
    next = end;
    return part;
  };
  const places = new Uint16Array(take(vertices * 8));
  const colors = (flags & HAS_COLORS) !== 0 ? new Uint8Array(take(vertices * 4)) : null;
  const indices =
    (flags & WIDE) !== 0 ? new Uint32Array(take(triangles * 12)) : new Uint16Array(take(triangles * 6));
  for (const index of indices) {
    if (index >= vertices) throw new Error('a triangle of a piece has no vertex');
  }
  return [{ key, places, colors, indices }, Math.ceil(next / 4) * 4];
}

function cut(): Error {
  return new Error('a piece of a mesh is cut short');
}

/** The world place of a vertex, into `out`. */
export function placeOf(piece: Piece, vertex: number, pieceM: number, out: Float32Array | number[]): void {
  for (let axis = 0; axis < 3; axis += 1) {
    const place = piece.places[4 * vertex + axis] ?? 0;
    out[axis] = ((piece.key[axis] ?? 0) + place / 65535) * pieceM;
  }
}

/** The unit normals, four a vertex of which the last is 0: two bytes of an unfolded octahedron become
 * what shaders read as it is. */
export function normalsOf({ places }: Piece): Int8Array {
  const normals = new Int8Array(places.length);
  for (let at = 0; at < places.length; at += 4) {
    const both = places[at + 3] ?? 0;
    let [x, y] = [(both & 255) / 127.5 - 1, (both >> 8) / 127.5 - 1];
    const z = 1 - Math.abs(x) - Math.abs(y);
    const below = Math.max(-z, 0);
    x += x < 0 ? below : -below;
    y += y < 0 ? below : -below;
    const scale = 127 / Math.max(Math.hypot(x, y, z), 1e-6);
    normals[at] = Math.round(x * scale);
    normals[at + 1] = Math.round(y * scale);
    normals[at + 2] = Math.round(z * scale);
  }
  return normals;
}
