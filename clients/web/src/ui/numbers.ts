// Numbers as people read them.

const SPACE = ' ';

export function count(n: number): string {
  if (n < 10_000) return Math.round(n).toLocaleString('en');
  if (n < 1e6) return `${(n / 1e3).toFixed(n < 1e5 ? 1 : 0)}${SPACE}k`;
  return `${(n / 1e6).toFixed(n < 1e7 ? 2 : 1)}${SPACE}M`;
}

export function rate(n: number): string {
  return n === 0 ? '0' : n.toFixed(n < 10 ? 1 : 0);
}

export function bytes(n: number): string {
  if (n < 1e6) return `${(n / 1e3).toFixed(0)}${SPACE}kB`;
  if (n < 1e9) return `${(n / 1e6).toFixed(n < 1e7 ? 1 : 0)}${SPACE}MB`;
  return `${(n / 1e9).toFixed(2)}${SPACE}GB`;
}

export function metres(m: number, places = 2): string {
  return `${minus(m.toFixed(places))}${SPACE}m`;
}

export function small(n: number): string {
  if (n === 0) return '0';
  if (Math.abs(n) >= 1000) return count(n);
  return minus(Math.abs(n) < 0.001 ? n.toExponential(1) : n.toPrecision(3));
}

export function milliseconds(ms: number): string {
  if (ms >= 10_000) return `${(ms / 1000).toFixed(0)}${SPACE}s`;
  if (ms >= 1000) return `${(ms / 1000).toFixed(1)}${SPACE}s`;
  return `${ms.toFixed(ms < 10 ? 1 : 0)}${SPACE}ms`;
}

/** x, y, z in metres. */
export function place(at: readonly number[], places = 2): string {
  return at.map((x) => minus(x.toFixed(places))).join(', ');
}

/** A hyphen is no minus; nor is there a negative zero. */
function minus(text: string): string {
  return text.replace(/^-(?=0(\.0*)?$)/, '').replace(/^-/, '−');
}

export function ago(ms: number): string {
  if (ms < 2_000) return 'now';
  if (ms < 120_000) return `${Math.round(ms / 1000)}${SPACE}s ago`;
  if (ms < 7_200_000) return `${Math.round(ms / 60_000)}${SPACE}min ago`;
  if (ms < 172_800_000) return `${Math.round(ms / 3_600_000)}${SPACE}h ago`;
  return `${Math.round(ms / 86_400_000)}${SPACE}days ago`;
}
