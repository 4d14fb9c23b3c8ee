// How many frames a second the page draws in software while it turns, and what it leaves out for that.
// Nothing is judged: what a machine draws depends on what else it does. `npm run speed`; PROGRAM, CHROMIUM
// and DIST are those of run.mjs.
//   ROUNDS   movements, of 8 s each, in either form (3)
//   R0       map.r0_m: the smaller, the more triangles (0.09: about 230 000 of the synthetic room)
import { loadavg } from 'node:os';

import { launch, newContext, triangles, until } from './browser.mjs';
import { serve, stopAll, stream } from './server.mjs';

const { ROUNDS: rounds = '3', R0: r0 = '0.09' } = process.env;
const WINDOWS = 4;
const WINDOW_MS = 2_000;

/** Turns for a while; frames a second and the median time of a frame, a window at a time. */
async function turn(page) {
  await page.locator('.view-canvas').focus();
  await page.keyboard.down('ArrowLeft');
  const windows = await page.evaluate(([count, span]) => new Promise((done) => {
    const stamps = [];
    const frame = (now) => {
      stamps.push(now);
      if (now - stamps[0] < count * span) return requestAnimationFrame(frame);
      const found = Array.from({ length: count }, (_, i) => {
        const at = (stamp) => stamp - stamps[0];
        const inside = stamps.filter((stamp) => at(stamp) >= i * span && at(stamp) < (i + 1) * span);
        const times = inside.slice(1).map((stamp, j) => stamp - inside[j]).sort((a, b) => a - b);
        return { rate: (inside.length * 1000) / span, median: times[times.length >> 1] ?? Infinity };
      });
      done(found);
    };
    requestAnimationFrame(frame);
  }), [WINDOWS, WINDOW_MS]);
  await page.keyboard.up('ArrowLeft');
  return windows;
}

async function main() {
  const server = await serve({ set: [`map.r0_m=${r0}`, 'map.steps=0'] });
  const sent = await stream(server.grpc, '--stride', '3');
  if (sent !== 0) throw new Error('the robot did not drive to the end');
  const browser = await launch();
  const context = await newContext(browser, { viewport: { width: 1280, height: 800 } });
  const page = await context.newPage();
  await page.goto(server.url);
  await page.getByLabel('How finely the surface is drawn').selectOption('fine');
  let [last, same] = [0, 0];
  await until(page, 'all of it is there', async () => {
    const now = await triangles(page);
    same = now === last && now > 0 ? same + 1 : 0;
    last = now;
    return same > 40;
  });
  console.log(`${last} triangles, 1280 × 800`);
  for (const form of ['triangles', 'points']) {
    if (form === 'points') await page.keyboard.press('p');
    for (let round = 0; round < Number(rounds); round += 1) {
      const windows = await turn(page);
      const rates = windows.map(({ rate, median }) => `${rate.toFixed(0)} (${median.toFixed(0)} ms)`);
      const said = await page.locator('.drawn').innerText();
      console.log(`${form}: ${rates.join(', ')} frames/s; load ${loadavg()[0]?.toFixed(1)}; “${said.replace('\n', ' | ')}”`);
    }
  }
  await browser.close();
  await server.kill();
}

await main().finally(stopAll);
