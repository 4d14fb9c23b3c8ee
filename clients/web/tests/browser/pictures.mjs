// Takes the pictures of the README: a robot goes on mapping the synthetic room, somebody looks for a blanket,
// and a slice on a phone. `npm run pictures -- FOLDER`; PROGRAM, ENCODER, CHROMIUM and DIST are those of
// run.mjs. On a machine with nothing else to do: the page shows how soon frames are seen.
import { mkdirSync } from 'node:fs';
import { join } from 'node:path';

import { launch, newContext, triangles, until } from './browser.mjs';
import { folder, map, serve, stopAll, stream } from './server.mjs';

const { ENCODER: encoder = new URL('../../../../target/encoders/static', import.meta.url).pathname } = process.env;
const [, , into = '.'] = process.argv;
// Edges are smooth where a screen has four pixels for each of the picture.
const SIZE = { viewport: { width: 1280, height: 800 }, deviceScaleFactor: 2 };
/** Of nearly all of the room, at the detail that a page begins with. */
const ROOM_TRIANGLES = 100_000;
/** For a view to come to rest, and the notice to go. */
const REST_MS = 6_000;

async function opened(browser, server, options) {
  const context = await newContext(browser, options);
  const page = await context.newPage();
  page.setDefaultTimeout(120_000);
  await page.goto(server.url);
  await until(page, 'the room is there', async () => (await triangles(page)) > ROOM_TRIANGLES);
  await page.waitForTimeout(REST_MS);
  return page;
}

async function main() {
  const storage = folder();
  mkdirSync(join(storage, 'default'));
  await map(join(storage, 'default', 'map.orenx'), encoder, '--stride', '4');
  const server = await serve({ encoder, storage });
  const browser = await launch();
  const dark = await opened(browser, server, { ...SIZE, colorScheme: 'dark' });
  const ended = stream(server.grpc, '--labels', '--frames', '480..600', '--stride', '8');
  await dark.locator('.robot-facts').filter({ hasText: /^([5-9]|1\d) of/ }).waitFor();
  await dark.waitForTimeout(REST_MS / 2);
  await dark.screenshot({ path: `${into}/dashboard.png`, scale: 'css' });
  if ((await ended) !== 0) throw new Error('the robot did not drive to the end');
  await dark.close();
  const light = await opened(browser, server, { ...SIZE, colorScheme: 'light' });
  await light.getByLabel('Where is what? Ask in words').fill('where is the blanket?');
  await light.keyboard.press('Enter');
  await light.locator('.match').first().waitFor();
  await light.locator('.view-canvas').focus();
  await light.waitForTimeout(REST_MS);
  await light.screenshot({ path: `${into}/dashboard-words.png`, scale: 'css' });
  await light.close();
  const phone = await opened(browser, server, {
    viewport: { width: 390, height: 844 }, colorScheme: 'dark', hasTouch: true, isMobile: true, deviceScaleFactor: 2,
  });
  await phone.getByRole('tab', { name: 'Slice' }).click();
  await phone.getByLabel('Draw the slice in the map').check({ force: true });
  await phone.waitForTimeout(REST_MS);
  await phone.screenshot({ path: `${into}/dashboard-phone.png` });
  await browser.close();
  await server.kill();
}

await main().finally(stopAll);
