// The lock file names no registry, pins every package by its hash, and no package runs a script when installed.
// usage: node lock_file_test.mjs package-lock.json

import { readFileSync } from 'node:fs';
import { dirname, join } from 'node:path';

const text = readFileSync(process.argv[2], 'utf8');
const packages = Object.entries(JSON.parse(text).packages).filter(([path]) => path !== '');
const faults = [
  ...(/https?:\/\/[^"]*(registry|npmjs|tgz)/.test(text) ? ['a registry address'] : []),
  ...packages.filter(([, entry]) => entry.resolved !== undefined).map(([path]) => `${path}: resolved`),
  ...packages.filter(([, entry]) => !entry.integrity).map(([path]) => `${path}: no integrity`),
];
const npmrc = join(dirname(process.argv[2]), '.npmrc');
const ignored = readFileSync(npmrc, 'utf8').includes('ignore-scripts=true');
if (!ignored) faults.push(`${npmrc}: found no ignore-scripts=true`);
console.log(faults.join('\n') || `${packages.length} packages pinned`);
process.exit(faults.length === 0 && packages.length > 5 ? 0 : 1);
