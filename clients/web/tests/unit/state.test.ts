import { describe, expect, it } from 'vitest';

import type { MapStats } from '../../src/api/types';
import { History } from '../../src/history';
import { Heat } from '../../src/mesh/heat';
import { tinted } from '../../src/mesh/tint';
import { Pace } from '../../src/scene/pace';
import { distanceAt, sliceColor } from '../../src/scene/slice';
import { Signal } from '../../src/signal';
import { ago, bytes, count, metres, milliseconds } from '../../src/ui/numbers';

function stats(integrated: number, sumS: number, dropped = 0): MapStats {
  return {
    map: { map_id: 'm', epoch: integrated, newest_stamp_ns: 0, bounds: null, modalities: [] },
    counts: {
      received: integrated + dropped, integrated, dropped: { REPLACED: dropped }, rejected: {}, waiting: 0, lost: 0,
    },
    visible_after: { frames: integrated, sum_s: sumS },
    losses: { total: 1 / (integrated + 1) },
    frames: integrated, map_bytes: 5, resident_bytes: 9, atoms: 0, robots: [],
    frames_empty: 0, steps: 0, voxels: 0, rows: 0, surfels: 0, key_frames: 0, voxels_refused: 0, stages_ms: {}, server_us: 0,
  };
}

describe('the counters of the last minutes', () => {
  it('become rates and times between two of them', () => {
    const history = new History();
    expect(history.add(stats(0, 0), 0)).toMatchObject({ framesPerSecond: 0, latencyMs: null });
    const sample = history.add(stats(10, 0.5, 3), 1000);
    expect(sample.framesPerSecond).toBeCloseTo(10);
    expect(sample.latencyMs).toBeCloseTo(50);
    expect(sample.refused).toBe(3);
    expect(history.add(stats(10, 0.5, 3), 9000)).toMatchObject({ framesPerSecond: 0, latencyMs: null });
  });

  it('begin anew with a server that was started anew, and have a bound', () => {
    const history = new History();
    for (let i = 0; i < 1000; i += 1) history.add(stats(i, i), i * 250);
    expect(history.samples.length).toBe(240);
    history.add(stats(1, 0.1), 251_000);
    expect(history.samples.length).toBe(1);
  });
});

describe('where a text fits', () => {
  const heat = new Heat([[0, 0, 0], [0.1, 0, 0], [0.3, 0, 0]], [0.5, 0.9, 0.7]);

  it('is hot at the best place, and cold away from all', () => {
    expect(heat.at([0.1, 0, 0])).toBeCloseTo(1);
    expect(heat.at([0, 0, 0])).toBeCloseTo(0.3);
    expect(heat.at([0.05, 0, 0])).toBeCloseTo(0.65);
    expect(heat.at([0.1, 0.05, 0])).toBeCloseTo(0.5);
    expect(heat.at([2, 2, 2])).toBe(0);
    expect(new Heat([], []).at([0, 0, 0])).toBe(0);
  });
});

describe('colours of a piece', () => {
  it('spread to neighbours that have none', () => {
    const colors = new Uint8Array([200, 100, 0, 255, 0, 0, 0, 0, 0, 0, 0, 0]);
    const piece = { key: [0, 0, 0] as [number, number, number], places: new Uint16Array(12), colors, indices: new Uint16Array([0, 1, 2]) };
    expect([...tinted(piece).slice(4, 8)]).toEqual([200, 100, 0, 255]);
    expect([...tinted({ ...piece, colors: null })]).toEqual(Array(12).fill(0));
    expect(colors[7]).toBe(0);
  });
});

describe('the pace', () => {
  it('draws less while frames are late, and all again once they are not', () => {
    const pace = new Pace();
    expect(pace.quality).toEqual({ pixels: 2, level: 0 });
    for (let i = 0; i < 5; i += 1) pace.frame(60);
    expect(pace.quality).toEqual({ pixels: 1.4, level: 0 });
    for (let i = 0; i < 100; i += 1) pace.frame(60);
    expect(pace.isLeast).toBe(true);
    expect(pace.quality).toEqual({ pixels: 0.5, level: 2 });
    for (let i = 0; i < 100_000 && pace.isLess; i += 1) pace.frame(8);
    expect(pace.isLess).toBe(false);
    for (let i = 0; i < 1000; i += 1) pace.frame(8);
    expect(pace.isQuick).toBe(true);
  });

  it('goes down faster where frames are very late, and is content with thirty a second', () => {
    const [late, fair] = [new Pace(), new Pace()];
    for (let i = 0; i < 5; i += 1) late.frame(250);
    expect(late.quality).toEqual({ pixels: 1, level: 1 });
    expect(new Pace(true).quality).toEqual({ pixels: 1, level: 1 });
    for (let i = 0; i < 1000; i += 1) fair.frame(1000 / 30);
    expect(fair.isLess).toBe(false);
  });

  it('does not count frames of two movements together', () => {
    const pace = new Pace();
    for (let i = 0; i < 50; i += 1) {
      pace.begin();
      for (let frame = 0; frame < 4; frame += 1) pace.frame(60);
    }
    expect(pace.isLess).toBe(false);
  });

  it('does not mistake a pause for a slow frame', () => {
    const pace = new Pace();
    for (let i = 0; i < 100; i += 1) pace.frame(30_000);
    expect(pace.isLess).toBe(false);
  });
});

describe('a slice', () => {
  const slice = {
    origin: [-1, -1, 0.5] as [number, number, number], resolution: 0.5, width: 2, height: 2, epoch: 1,
    distance: new Float32Array([0.1, 0.2, 0.3, NaN]),
  };

  it('is read by place', () => {
    expect(distanceAt(slice, -0.4, -0.9)).toBeCloseTo(0.2);
    expect(distanceAt(slice, -0.9, -0.4)).toBeCloseTo(0.3);
    expect(distanceAt(slice, 5, 0)).toBeNaN();
    expect(distanceAt(slice, -0.4, -0.4)).toBeNaN();
  });

  it('has other colours inside than outside', () => {
    expect(sliceColor(-0.2)[0]).toBeGreaterThan(sliceColor(-0.2)[2]);
    expect(sliceColor(1.5)[2]).toBeGreaterThan(sliceColor(1.5)[0]);
  });
});

describe('a signal', () => {
  it('tells its value at once and when it changes, until one leaves', () => {
    const signal = new Signal(1);
    const seen: number[] = [];
    const leave = signal.watch((value) => seen.push(value));
    signal.set(1);
    signal.set(2);
    leave();
    signal.set(3);
    expect(seen).toEqual([1, 2]);
  });
});

describe('numbers', () => {
  it('are short and have true signs', () => {
    expect([count(999), count(95_614), count(1_234_567)]).toEqual(['999', '95.6 k', '1.23 M']);
    expect([bytes(512_000), bytes(122e6), bytes(3.2e9)]).toEqual(['512 kB', '122 MB', '3.20 GB']);
    expect([metres(-0.5), metres(-0.001), metres(1.2346, 3)]).toEqual(['−0.50 m', '0.00 m', '1.235 m']);
    expect([milliseconds(4.25), milliseconds(126.4), milliseconds(2500)]).toEqual(['4.3 ms', '126 ms', '2.5 s']);
    expect([ago(500), ago(30_000), ago(600_000)]).toEqual(['now', '30 s ago', '10 min ago']);
  });
});
