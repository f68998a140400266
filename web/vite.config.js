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

const folderOf = (path) => /\/src\/(\w+)\/index\.tsx$/.exec(path ?? '')?.[1];

export default defineConfig({
  base: './',
  plugins: [contentSecurityPolicy],
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
    // three.js is one piece of some 600 kB before compression, fetched with the first view in 3D.
    chunkSizeWarningLimit: 900,
  },
  server: { proxy: Object.fromEntries(['/v1', '/livez', '/openapi.json'].map((path) => [path, { target: 'http://127.0.0.1:8080', changeOrigin: false }])) },
});
