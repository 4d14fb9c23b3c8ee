import { loadEnv } from 'vite';
import { defineConfig } from 'vitest/config';

// The server behind the page while it is worked on: `npm run dev`, beside `orenx serve`.
const server = loadEnv('', '.', 'ORENX_').ORENX_URL ?? 'http://127.0.0.1:7611';
// The host stays as the browser has it: the server refuses pages of other sites.
const behind = { target: server, changeOrigin: false };
const proxy = { '/v1': behind, '/readyz': behind, '/metrics': behind, '/openapi.json': behind };

export default defineConfig({
  // The licence of what others wrote goes with it.
  esbuild: { legalComments: 'inline' },
  build: {
    target: 'es2022',
    // `build/dist.mjs` empties it, but for the file that keeps it in the repository.
    emptyOutDir: false,
    // Every file is one that the server's policy allows: nothing is written into the page.
    assetsInlineLimit: 0,
    modulePreload: { polyfill: false },
    chunkSizeWarningLimit: 900,
  },
  server: { proxy },
  preview: { proxy },
  test: { include: ['tests/unit/**/*.test.ts'], environment: 'node' },
});
