// The page in a real browser, against a real server and a real stream. Prints a line a test and, at the
// end, `N passed, N failed`.
//   PROGRAM        the program (target/release/orenx)
//   ENCODER        the folder of a static text encoder; without it the question in words is skipped
//   DIST           a folder with the page, in place of the one that the program has in it
//   CHROMIUM       the browser (/usr/bin/chromium)
//   SHOTS          a folder for pictures of what was seen
// An argument is a part of the names of the tests that are wanted.
import { DEADLINE_MS, check, launch, newContext, open, shoot, triangles, until } from './browser.mjs';
import { guardedTests } from './guarded.mjs';
import { serve, stopAll, stream } from './server.mjs';

const { ENCODER: encoder = '' } = process.env;

/** What the room is: its wall at x = 3, and the middle of its blanket. */
const WALL_X = 3;
const BLANKET = [1.62, 1.5, 0.42];

const tests = [];
const test = (name, run) => tests.push({ name, run });

/** The middle of the picture that the server is asked for: where the eye is and looks. */
async function eye(page) {
  const asked = page.waitForRequest((request) => request.url().endsWith('/render'));
  await page.keyboard.press('r');
  const { world_from_camera: pose } = (await asked).postDataJSON();
  const [x, y, z, w] = pose.rotation;
  const ahead = [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)];
  return { at: pose.translation, ahead };
}

test('an empty map says so, and a room appears in it and grows', async ({ page, server }) => {
  await page.getByText('Nothing is mapped yet').waitFor();
  const ended = stream(server.grpc, '--stride', '8', ...(encoder ? ['--labels'] : []));
  await until(page, 'the room appears', async () => (await triangles(page)) > 1000);
  const first = await triangles(page);
  await page.getByText('Nothing is mapped yet').waitFor({ state: 'hidden' });
  check((await page.locator('.label').textContent()) === 'recording', 'the robot has its name');
  await until(page, 'the room grows', async () => (await triangles(page)) > 2 * first);
  await shoot(page, 'growing');
  check((await ended) === 0, 'the robot drove to the end');
});

test('the slice shows the distance that the room has', async ({ page }) => {
  await open(page, 'Slice');
  await page.getByLabel('Draw the slice in the map').check({ force: true });
  const answer = page.waitForResponse((response) => response.url().includes('/slice.bin?z=2.2'));
  await page.getByLabel('Height', { exact: true }).fill('2.2');
  const head = (await answer).headers();
  const [x0, y0] = head['orenx-origin-m'].split(',').map(Number);
  const cell = Number(head['orenx-resolution-m']);
  const [width, height] = [Number(head['orenx-width']) * cell, Number(head['orenx-height']) * cell];
  const box = await page.locator('.slice-map').boundingBox();
  const asked = page.waitForResponse((response) => response.url().endsWith('/query/points'));
  const place = { x: ((2.6 - x0) / width) * box.width, y: (1 - (0 - y0) / height) * box.height };
  await page.locator('.slice-map').hover({ position: place });
  const [x] = JSON.parse((await asked).request().postData()).points_m[0];
  const value = page.locator('.reading-value');
  await value.filter({ hasText: /m$/ }).waitFor();
  const shown = Number(await value.getAttribute('data-distance'));
  check(Math.abs(x - 2.6) < 0.05, `asked at x = ${x}`);
  check(Math.abs(shown - (WALL_X - x)) < 0.03, `${shown} m is shown, ${WALL_X - x} m is right`);
  await page.locator('.state.free').waitFor();
  // A place that was typed, outside of everything.
  for (const [axis, number] of [['x', '20'], ['y', '0'], ['z', '1']]) {
    await page.getByLabel(`${axis}, metres`).fill(number);
  }
  await page.getByRole('button', { name: 'Ask' }).click();
  await value.filter({ hasText: 'unknown' }).waitFor();
  await shoot(page, 'slice');
  await page.getByLabel('Draw the slice in the map').uncheck({ force: true });
});

test('a question in words flies to the thing', async ({ page, skip }) => {
  if (!encoder) return skip('ENCODER is not set');
  await page.keyboard.press('/');
  await page.keyboard.type('where is the blanket?');
  await page.keyboard.press('Enter');
  await page.locator('.match').first().waitFor();
  await page.keyboard.press('Tab');
  await page.locator('.view-canvas').focus();
  // The eye needs a moment; its last place is looked at, not its way.
  let off = Infinity;
  await until(page, 'the eye looks at the blanket', async () => {
    const { at, ahead } = await eye(page);
    const to = BLANKET.map((x, i) => x - at[i]);
    const along = to.reduce((sum, x, i) => sum + x * ahead[i], 0);
    off = Math.hypot(...to.map((x, i) => x - along * ahead[i]));
    return along > 0 && along < 6 && off < 0.5;
  });
  await shoot(page, 'found');
  await page.keyboard.press('Escape');
  await page.locator('.results').waitFor({ state: 'hidden' });
});

test('a picture from here shows something', async ({ page }) => {
  await page.keyboard.press('f');
  await open(page, 'Picture');
  await page.getByLabel('Show', { exact: true }).selectOption('normal');
  await page.getByRole('button', { name: 'Draw from here' }).click();
  await page.getByText(/drawn in .* from epoch/).waitFor();
  const lit = await page.locator('canvas.picture').evaluate((canvas) => {
    const { data } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
    return data.filter((byte, i) => i % 4 === 0 && byte > 0).length / (data.length / 4);
  });
  check(lit > 0.1, `${(lit * 100).toFixed(0)} % of the picture is lit`);
});

test('maps are made, chosen and deleted', async ({ page }) => {
  await open(page, 'Maps');
  await page.getByLabel('New map').fill('attic');
  await page.getByRole('button', { name: 'Create' }).click();
  await page.getByText('Nothing is mapped yet').waitFor();
  await page.locator('[data-map="default"] .map-choice').click();
  await until(page, 'the room is back', async () => (await triangles(page)) > 1000);
  await page.getByRole('button', { name: 'Delete the map attic' }).click();
  await page.getByRole('button', { name: 'Delete', exact: true }).click();
  await page.locator('[data-map="attic"]').waitFor({ state: 'detached' });
});

test('it fits a phone, and nothing leaves this host', async ({ context, url, hosts }) => {
  const page = await context.newPage();
  await page.setViewportSize({ width: 390, height: 844 });
  await page.goto(url);
  await until(page, 'the room is there', async () => (await triangles(page)) > 1000);
  for (const tab of ['Health', 'Slice', 'Picture', 'Maps']) {
    await open(page, tab);
    const wide = await page.evaluate(() => document.documentElement.scrollWidth);
    check(wide <= 390, `${tab} is ${wide} pixels wide`);
    await page.getByRole('tabpanel', { name: tab }).waitFor();
  }
  await shoot(page, 'phone');
  await page.close();
  check(hosts.size === 1, `hosts: ${[...hosts].join(', ')}`);
});

test('a killed server is noticed, and the page recovers', async (state) => {
  const { page, server } = state;
  await server.kill();
  await page.getByText('The server is gone').waitFor({ timeout: DEADLINE_MS });
  check((await triangles(page)) > 1000, 'what was seen stays');
  await shoot(page, 'gone');
  state.server = await serve({ ...server, encoder });
  await page.locator('.link.live').waitFor({ timeout: DEADLINE_MS });
  // Another server with an empty map: what the old one said is gone.
  await page.getByText('Nothing is mapped yet').waitFor();
  await until(page, 'the old room is gone', async () => (await triangles(page)) === 0);
  stream(state.server.grpc, '--frames', '0..40', '--stride', '8');
  await until(page, 'a new room appears', async () => (await triangles(page)) > 1000);
});

async function main() {
  const browser = await launch();
  const context = await newContext(browser, { viewport: { width: 1280, height: 800 } });
  const state = { context, hosts: new Set(), server: await serve({ encoder }) };
  state.url = state.server.url;
  context.on('request', (request) => {
    const { protocol, host } = new URL(request.url());
    if (protocol.startsWith('http')) state.hosts.add(host);
  });
  state.page = await context.newPage();
  state.page.on('pageerror', (error) => console.log(`error in the page: ${error.message}`));
  state.page.setDefaultTimeout(DEADLINE_MS);
  await state.page.goto(state.url);
  let [passed, failed] = [0, 0];
  const wanted = [...tests, ...guardedTests].filter(({ name }) => name.includes(process.argv[2] ?? ''));
  for (const { name, run } of wanted) {
    let skipped = '';
    const started = Date.now();
    try {
      await run(Object.assign(state, { skip: (why) => (skipped = why) }));
      passed += 1;
      const took = `${((Date.now() - started) / 1000).toFixed(1)} s`;
      console.log(skipped ? `skipped: ${name}: ${skipped}` : `ok: ${name} (${took})`);
    } catch (error) {
      failed += 1;
      await shoot(state.page, `failed-${failed}`);
      console.log(`FAILED: ${name}: ${error.message}`);
    }
  }
  await browser.close();
  stopAll();
  console.log(`${passed} passed, ${failed} failed`);
  process.exit(failed === 0 ? 0 : 1);
}

main().catch((error) => {
  stopAll();
  console.log(`FAILED: ${error.message}`);
  process.exit(1);
});
