import { createHash } from 'node:crypto';
import { defineConfig } from 'vite';

// The server sends the same policy as a header; the page carries it too, so that it holds behind any
// other file server. Not in `vite dev`, which injects style elements.
const kPolicy =
  "default-src 'self'; style-src 'self'; script-src 'self'; img-src 'self'; connect-src 'self'; " +
  "object-src 'none'; base-uri 'none'; form-action 'none'";

const contentSecurityPolicy = {
  name: 'content-security-policy',
  apply: 'build',
  transformIndexHtml: () => [
    {
      tag: 'meta',
      attrs: { 'http-equiv': 'Content-Security-Policy', content: kPolicy },
      injectTo: 'head-prepend',
    },
  ],
};

// Swagger UI's styles have pictures as data: addresses, which the policy refuses. They become files beside the styles.
const picturesAsFiles = {
  name: 'pictures-as-files',
  apply: 'build',
  generateBundle(_, bundle) {
    for (const sheet of Object.values(bundle)) {
      if (!sheet.fileName.endsWith('.css')) continue;
      sheet.source = String(sheet.source).replace(/url\((["']?)data:image\/(\w+)[^,]*?(;base64)?,(.*?)\1\)/gs, (_, quote, type, base64, data) => {
        const plain = data.replace(/\\(?=["'])/g, '');
        const source = base64 ? Buffer.from(plain, 'base64') : decodeURIComponent(plain);
        const name = `picture-${createHash('sha256').update(source).digest('hex').slice(0, 8)}.${type.replace('jpeg', 'jpg')}`;
        bundle[`assets/${name}`] ?? this.emitFile({ type: 'asset', fileName: `assets/${name}`, source });
        return `url(./${name})`;
      });
    }
  },
};

const folderOf = (path) => /\/src\/(\w+)\/index\.tsx$/.exec(path ?? '')?.[1];

export default defineConfig({
  base: './',
  plugins: [contentSecurityPolicy, picturesAsFiles],
  esbuild: { jsx: 'automatic', jsxImportSource: 'preact' },
  build: {
    target: 'es2022',
    // data: addresses would need a wider policy.
    assetsInlineLimit: 0,
    modulePreload: { polyfill: false },
    // A view's piece is named as its folder.
    rollupOptions: {
      output: { chunkFileNames: ({ facadeModuleId }) => `assets/${folderOf(facadeModuleId) ?? '[name]'}-[hash].js` },
    },
    // three.js and Swagger UI are one script each, loaded with the views that need them.
    chunkSizeWarningLimit: 1700,
  },
  server: { proxy: Object.fromEntries(['/v1', '/livez', '/openapi.json'].map((path) => [path, { target: 'http://127.0.0.1:8080', changeOrigin: false }])) },
});
