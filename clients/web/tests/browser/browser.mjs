// What every test does with a page: waits, looks, opens.
import { existsSync } from 'node:fs';
import { join } from 'node:path';

import { chromium } from 'playwright-core';

export const DEADLINE_MS = 120_000;
const { SHOTS: shots = '', DIST: dist = '' } = process.env;

/** A browser as it is on a machine without a GPU: SwiftShader draws for WebGL, and the rest needs none. */
export function launch(...more) {
  return chromium.launch({
    executablePath: process.env.CHROMIUM ?? '/usr/bin/chromium',
    args: [
      '--headless', '--no-sandbox', '--use-angle=swiftshader-webgl', '--enable-unsafe-swiftshader',
      '--disable-background-networking', '--disable-component-update', '--disable-sync',
      '--no-first-run', '--disable-quic', ...more,
    ],
  });
}

/** Pages that know nothing of each other's keys; those of DIST, if it is set. */
export async function newContext(browser, options) {
  const context = await browser.newContext(options);
  if (dist) {
    await context.route(({ pathname }) => pathname === '/' || pathname.startsWith('/assets/'), (route) => {
      const { pathname } = new URL(route.request().url());
      const path = join(dist, pathname === '/' ? 'index.html' : pathname);
      return existsSync(path) ? route.fulfill({ path }) : route.fulfill({ status: 404 });
    });
  }
  return context;
}

export function check(is, message) {
  if (!is) throw new Error(message);
}

export const triangles = (page) => page.locator('.drawn').evaluate((e) => Number(e.dataset.triangles ?? 0));

export async function until(page, what, is) {
  const deadline = Date.now() + DEADLINE_MS;
  // A new frame each time: nothing is slept through.
  while (!(await is())) {
    check(Date.now() < deadline, `${what}: not within ${DEADLINE_MS / 1000} s`);
    await page.evaluate(() => new Promise((done) => setTimeout(done, 50)));
  }
}

/** Opens a page of the panel; what is open stays open. */
export async function open(page, name) {
  const tab = page.getByRole('tab', { name });
  if ((await tab.getAttribute('aria-selected')) !== 'true') await tab.click();
}

export async function shoot(page, name) {
  if (shots) await page.screenshot({ path: `${shots}/${name}.png` });
}
