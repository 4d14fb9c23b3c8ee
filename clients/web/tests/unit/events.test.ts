import { describe, expect, it } from 'vitest';

import { Backoff } from '../../src/api/backoff';
import { EventReader } from '../../src/api/events';

describe('events', () => {
  it('come whole, however they are cut', () => {
    const text = ': hello\n\nevent: status\ndata: {"a":1}\n\ndata: one\r\ndata: two\r\n\r\nevent: end\ndata: x\n\n';
    const expected = [
      { event: 'status', data: '{"a":1}' },
      { event: 'message', data: 'one\ntwo' },
      { event: 'end', data: 'x' },
    ];
    expect(new EventReader().push(text)).toEqual(expected);
    const reader = new EventReader();
    const slow = [...text.replaceAll('\r', '')].flatMap((letter) => reader.push(letter));
    expect(slow).toEqual(expected);
  });

  it('that never end are refused', () => {
    const reader = new EventReader();
    expect(() => reader.push('data: '.padEnd(5 << 20, 'x'))).toThrow(/too long/);
  });
});

describe('coming back', () => {
  it('waits twice as long each time, up to a bound, and begins anew', () => {
    const backoff = new Backoff(() => 1);
    const waits = Array.from({ length: 8 }, () => backoff.next());
    expect(waits).toEqual([500, 1000, 2000, 4000, 8000, 15000, 15000, 15000]);
    backoff.reset();
    expect(backoff.next()).toBe(500);
    expect(new Backoff(() => 0).next()).toBe(375);
  });
});
