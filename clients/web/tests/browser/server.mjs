// The real program: servers that are started and killed, and robots that stream into them.
import { spawn } from 'node:child_process';
import { mkdtempSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { createInterface } from 'node:readline';

const program = process.env.PROGRAM ?? new URL('../../../../target/release/orenx', import.meta.url).pathname;
const running = new Set();
const folders = new Set();

/** What is set for tests is no setting of a server. */
const env = Object.fromEntries(Object.entries(process.env).filter(([name]) => !name.startsWith('ORENX_')));

/** Starts the program; `lines` are what it says. */
function start(args, more = {}) {
  const child = spawn(program, args, { env: { ...env, ...more }, stdio: ['ignore', 'pipe', 'inherit'] });
  running.add(child);
  const ended = new Promise((done) => child.on('exit', (code) => {
    running.delete(child);
    done(code);
  }));
  return { child, ended, lines: createInterface({ input: child.stdout }) };
}

/** A folder that is gone in the end. */
export function folder() {
  const made = mkdtempSync(join(tmpdir(), 'orenx-page-'));
  folders.add(made);
  return made;
}

/** A server on the ports that are given, or free ones. `keys` are secrets by role; `storage` is where it
 * keeps maps, `set` more settings. */
export async function serve({ grpc = 0, http = 0, encoder = '', keys = {}, storage = '', set: more = [] } = {}) {
  const set = [`server.grpc=127.0.0.1:${grpc}`, `server.http=127.0.0.1:${http}`, `storage.path=${storage}`, ...more];
  if (encoder) set.push('encoder.kind=static', `encoder.folder=${encoder}`);
  const args = set.flatMap((one) => ['--set', one]);
  const roles = Object.entries(keys);
  if (roles.length > 0) {
    const config = join(folder(), 'orenx.toml');
    const table = ([role, key]) => `[[auth.keys]]\nname = "the-${role}"\nrole = "${role}"\nkey = "${key}"\n`;
    writeFileSync(config, roles.map(table).join(''));
    args.push('--config', config);
  }
  const { child, ended, lines } = start(['serve', ...args]);
  const ports = {};
  for await (const line of lines) {
    const [, kind, port] = /(gRPC|HTTP) on \w+:\/\/127\.0\.0\.1:(\d+)/.exec(line) ?? [];
    if (kind) ports[kind.toLowerCase()] = Number(port);
    if (ports.grpc && ports.http) break;
  }
  if (!ports.http) throw new Error(`the server did not start: ${await ended}`);
  const kill = async () => {
    child.kill('SIGKILL');
    await ended;
  };
  return { ...ports, url: `http://127.0.0.1:${ports.http}/`, kill };
}

/** A robot that maps the synthetic room; ends with its stream. */
export function stream(grpc, ...options) {
  return streamWith('', grpc, ...options);
}

/** A robot that shows a key. */
export function streamWith(key, grpc, ...options) {
  const more = key === '' ? {} : { ORENX_API_KEY: key };
  return start(['stream', 'synthetic:room', `http://127.0.0.1:${grpc}`, ...options], more).ended;
}

/** A map file of the synthetic room, with what things are called. */
export async function map(file, encoder, ...options) {
  const code = await start(['map', 'synthetic:room', '--out', file, '--encoder', `static:${encoder}`, ...options]).ended;
  if (code !== 0) throw new Error('the room was not mapped');
}

/** Ends everything that was started. */
export function stopAll() {
  for (const child of running) child.kill('SIGKILL');
  for (const made of folders) rmSync(made, { recursive: true, force: true });
}
