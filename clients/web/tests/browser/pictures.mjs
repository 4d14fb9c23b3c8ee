// Takes the pictures of the README: a robot maps the synthetic room, somebody looks for a blanket, and the
// same on a phone. `npm run pictures -- FOLDER`; PROGRAM, ENCODER, CHROMIUM and DIST are those of run.mjs.
// On a machine with nothing else to do: the page shows how soon frames are seen.
import { launch, newContext, until } from './browser.mjs';
import { serve, stopAll, stream } from './server.mjs';

const { ENCODER: encoder = new URL('../../../../target/encoders/static', import.meta.url).pathname } = process.env;
const [, , into = '.'] = process.argv;
const QUESTION = 'where is the blanket?';
async function opened(browser, server, options) {
  const context = await newContext(browser, { deviceScaleFactor: 2, ...options });
  const page = await context.newPage();
  await page.goto(server.url);
  await page.getByLabel('How finely the surface is drawn').selectOption('fine');
  return page;
}

/** A robot that goes through some of the room's frames, and names what it sees. */
async function drive(server, frames, ...more) {
  const code = await stream(server.grpc, '--labels', '--frames', frames, '--stride', '2', ...more);
  if (code !== 0) throw new Error('the robot did not drive to the end');
}

/** Once the view has stood still for two seconds, with everything drawn. */
async function settled(page) {
  let still = 0;
  await until(page, 'the view stands still', async () => {
    still = /frames|Slow|^0 /.test(await page.locator('.drawn').innerText()) ? 0 : still + 1;
    return still > 40;
  });
}

async function ask(page) {
  await page.getByLabel('Where is what? Ask in words').fill(QUESTION);
  await page.keyboard.press('Enter');
  await page.locator('.match').first().waitFor();
  await page.locator('.view-canvas').focus();
  await page.mouse.move(5, 5);
  await settled(page);
}

async function main() {
  const server = await serve({ encoder });
  const browser = await launch();
  const dark = await opened(browser, server, { viewport: { width: 1280, height: 800 }, colorScheme: 'dark' });
  await drive(server, '0..540');
  const ended = drive(server, '540..600', '--rate', '2');
  await dark.getByText(/[1-9][.\d]* frames\/s/).waitFor();
  await settled(dark);
  await dark.screenshot({ path: `${into}/dashboard.png`, scale: 'css' });
  await ended;
  await dark.close();
  const light = await opened(browser, server, { viewport: { width: 1280, height: 800 }, colorScheme: 'light' });
  await settled(light);
  await ask(light);
  await light.screenshot({ path: `${into}/dashboard-words.png`, scale: 'css' });
  await light.close();
  const phone = await opened(browser, server, { viewport: { width: 390, height: 844 }, colorScheme: 'dark', hasTouch: true, isMobile: true });
  await settled(phone);
  await phone.getByRole('tab', { name: 'Slice' }).click();
  await phone.getByLabel('Draw the slice in the map').check({ force: true });
  await phone.getByText(/m$/).first().waitFor();
  await settled(phone);
  await phone.screenshot({ path: `${into}/dashboard-phone.png` });
  await browser.close();
  await server.kill();
}

await main().finally(stopAll);
