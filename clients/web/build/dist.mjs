// Before and after `vite build`: `clean` empties dist, `pack` writes what servers send as it is.
import { readdirSync, readFileSync, rmSync, statSync, writeFileSync } from 'node:fs';
import { join } from 'node:path';
import { brotliCompressSync, constants, gzipSync } from 'node:zlib';

const dist = new URL('../dist', import.meta.url).pathname;
const kept = '.gitignore';
const packed = /\.(html|js|css|svg)$/;

function clean() {
  for (const name of readdirSync(dist)) {
    if (name !== kept) rmSync(join(dist, name), { recursive: true });
  }
}

function files(folder) {
  return readdirSync(folder).flatMap((name) => {
    const path = join(folder, name);
    return statSync(path).isDirectory() ? files(path) : [path];
  });
}

function pack() {
  let weight = 0;
  for (const path of files(dist).filter((path) => packed.test(path))) {
    const plain = readFileSync(path);
    const brotli = brotliCompressSync(plain, {
      params: { [constants.BROTLI_PARAM_QUALITY]: 11, [constants.BROTLI_PARAM_SIZE_HINT]: plain.length },
    });
    writeFileSync(`${path}.br`, brotli);
    writeFileSync(`${path}.gz`, gzipSync(plain, { level: 9 }));
    weight += brotli.length;
  }
  console.log(`dashboard: ${(weight / 1024).toFixed(0)} KiB compressed`);
}

const steps = { clean, pack };
const step = steps[process.argv[2]];
if (!step) throw new Error('usage: dist.mjs clean|pack');
step();
