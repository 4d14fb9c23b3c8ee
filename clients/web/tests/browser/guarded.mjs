// A server with keys and a folder: who may do what on its page, and maps as files.
import { readFile } from 'node:fs/promises';

import { check, open, shoot, triangles, until } from './browser.mjs';
import { folder, serve, streamWith } from './server.mjs';

const KEYS = Object.fromEntries(['ingest', 'read', 'admin'].map((role) => [role, `${role}-0123456789abcdef`]));

export const guardedTests = [];
const test = (name, run) => guardedTests.push({ name, run });

/** Answers the question for a key. */
async function enter(page, key) {
  await page.getByRole('dialog', { name: 'API key' }).getByLabel('API key').fill(key);
  await page.getByRole('button', { name: 'Go on' }).click();
}

const roomIsThere = (page) => until(page, 'the room is there', async () => (await triangles(page)) > 1000);

/** What a click saves: its name and its bytes. */
async function saved(page, button) {
  const coming = page.waitForEvent('download');
  await page.getByRole('button', { name: button, exact: true }).click();
  const download = await coming;
  return { name: download.suggestedFilename(), path: await download.path(), bytes: await readFile(await download.path()) };
}

async function press(page, ...names) {
  for (const name of names) await page.getByRole('button', { name, exact: true }).click();
}

test('a server with keys asks for one, and says when it is none of its own', async (state) => {
  const server = await serve({ keys: KEYS, storage: folder() });
  const sent = await streamWith(KEYS.ingest, server.grpc, '--frames', '0..80', '--stride', '4');
  check(sent === 0, 'the robot with its key drove to the end');
  // A tab of its own, in which no key is kept.
  const page = await state.context.newPage();
  page.setDefaultTimeout(60_000);
  state.guarded = { page, server };
  await page.goto(server.url);
  await page.getByText('This server asks for a key').waitFor();
  await press(page, 'Cancel');
  await page.getByRole('alert').getByText('The server asks for an API key.').waitFor();
  await press(page, 'Enter a key');
  await enter(page, 'not-the-key-that-it-is');
  await page.getByText('The server does not know this key.').waitFor();
  await shoot(page, 'wrong-key');
  await enter(page, KEYS.read);
  await page.locator('.link.live').waitFor();
  await roomIsThere(page);
});

test('a key that reads may look and save, and is told what changes take', async ({ guarded: { page } }) => {
  await open(page, 'Maps');
  await page.locator('.looks-only').getByText('it takes a key with the role admin').waitFor();
  for (const name of ['Create', 'Empty the map …']) {
    check(await page.getByRole('button', { name }).isDisabled(), `${name} is for administrators`);
  }
  check(await page.getByText('Snapshots of this map').isHidden(), 'snapshots are for administrators');
  await shoot(page, 'read-key');
  const ply = await saved(page, 'Save the surface as PLY');
  check(ply.name === 'default.ply' && ply.bytes.subarray(0, 4).toString() === 'ply\n', `${ply.name} is a PLY file`);
  const glb = await saved(page, 'Save the surface as GLB');
  check(glb.name === 'default.glb' && glb.bytes.subarray(0, 4).toString() === 'glTF', `${glb.name} is a GLB file`);
  check(glb.bytes.readUInt32LE(8) === glb.bytes.length, 'the GLB file is whole');
});

test('a key of a robot is refused with the role that it takes', async ({ guarded: { page } }) => {
  await page.locator('.top').getByRole('button', { name: 'Use another key' }).click();
  await enter(page, KEYS.ingest);
  const banner = page.locator('.banner');
  await banner.getByText("This needs a key of the role read; 'the-ingest' has ingest").waitFor();
  await shoot(page, 'robot-key');
  await banner.getByRole('button', { name: 'Use another key' }).click();
  await enter(page, KEYS.admin);
  await page.locator('.link.live').waitFor();
  await page.locator('.looks-only').waitFor({ state: 'hidden' });
});

test('an administrator makes and deletes maps', async ({ guarded: { page } }) => {
  await page.getByLabel('New map').fill('cellar');
  await press(page, 'Create');
  await page.getByText('Nothing is mapped yet').waitFor();
  // One that is there already: the server says so, and the page shows it.
  await page.getByLabel('New map').fill('default');
  await press(page, 'Create');
  await page.locator('.maps-panel > [role=status]').getByText(/default/).waitFor();
  await page.locator('[data-map="default"] .map-choice').click();
  await roomIsThere(page);
  await press(page, 'Delete the map cellar', 'Delete');
  await page.locator('[data-map="cellar"]').waitFor({ state: 'detached' });
});

test('snapshots are taken, saved, gone back to, sent and deleted', async ({ guarded: { page, server } }) => {
  await page.getByText('None yet.').waitFor();
  await page.getByLabel('Now').fill('before');
  await press(page, 'Take');
  const row = page.locator('.snapshot').filter({ hasText: 'before' });
  await row.getByText(/MB|kB/).waitFor();
  await shoot(page, 'snapshots');
  const file = await saved(page, 'Download before');
  check(file.name === 'default-before.orenx' && file.bytes.length > 100_000, `${file.name} has ${file.bytes.length} bytes`);
  await press(page, 'Empty the map …', 'Empty it');
  await until(page, 'the map is empty', async () => (await triangles(page)) === 0);
  await press(page, 'Restore before', 'Restore');
  await roomIsThere(page);
  await page.getByLabel('From a file').setInputFiles({ name: 'Sent.orenx', mimeType: '', buffer: file.bytes });
  await page.locator('.snapshot').filter({ hasText: 'sent' }).getByText(/MB|kB/).waitFor();
  await page.getByLabel('From a file').setInputFiles({ name: 'bad.orenx', mimeType: '', buffer: file.bytes.subarray(1) });
  await page.locator('.maps-panel > [role=status]').filter({ hasNotText: 'Uploading' }).getByText(/./).waitFor();
  for (const name of ['before', 'sent']) {
    await press(page, `Delete ${name}`, 'Delete');
    await page.locator('.snapshot').filter({ hasText: name }).waitFor({ state: 'detached' });
  }
  await page.getByText('None yet.').waitFor();
  await page.close();
  await server.kill();
});
