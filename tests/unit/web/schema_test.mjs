import assert from 'node:assert/strict';
import { spawnSync } from 'node:child_process';
import { readFileSync } from 'node:fs';
import { test } from 'node:test';
import { fileURLToPath } from 'node:url';

const web = fileURLToPath(new URL('../../../web/', import.meta.url));

test('the types of the routes are those of the server’s document: npm run schema', () => {
  const { stdout, status, stderr } = spawnSync(process.execPath, [
    `${web}node_modules/openapi-typescript/bin/cli.js`, `${web}../server/openapi.json`, '--alphabetize',
  ], { encoding: 'utf8', maxBuffer: 1 << 26 });
  assert.equal(status, 0, stderr);
  assert.equal(readFileSync(`${web}src/api/schema.d.ts`, 'utf8'), stdout);
});
