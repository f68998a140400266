// Small line icons, 16 x 16. They are decoration: each has text beside it, or its button has a label.

const kPaths = {
  sun: 'M8 4.8a3.2 3.2 0 1 0 0 6.4 3.2 3.2 0 0 0 0-6.4M8 1v1.4M8 13.6V15M1 8h1.4M13.6 8H15M3 3l1 1M12 12l1 1M13 3l-1 1M4 12l-1 1',
  moon: 'M13.5 9.6A5.8 5.8 0 0 1 6.4 2.5a5.8 5.8 0 1 0 7.1 7.1z',
  system: 'M2 3h12v8H2zM6 14h4M8 11v3',
  key: 'M10.5 2a3.5 3.5 0 0 0-3.3 4.7L2 11.900V14h2.500v-1.500H6V11h1.500l1.3-1.300A3.5 3.5 0 1 0 10.5 2zM11 5h.01',
  upload: 'M8 11V2.500M4.5 6 8 2.5 11.5 6M2 11v2.500h12V11',
  plus: 'M8 3v10M3 8h10',
  close: 'M3.5 3.500l9 9M12.5 3.500l-9 9',
  check: 'M2.5 8.500l3.5 3.5 7.5-8',
  warning: 'M8 2 1.5 13.500h13zM8 6.500v3M8 11.500h.01',
  trash: 'M3 4.500h10M6 4.500V2.500h4v2M4.5 4.500l.5 9h6l.5-9M6.8 7v4M9.2 7v4',
  eye: 'M1 8s2.5-4.5 7-4.500S15 8 15 8s-2.5 4.5-7 4.500S1 8 1 8zM8 6a2 2 0 1 0 0 4 2 2 0 0 0 0-4z',
  compare: 'M8 1.500v13M2 4h4v8H2zM10 4h4v8h-4z',
  pin: 'M8 14.500S3 10 3 6.500a5 5 0 0 1 10 0C13 10 8 14.5 8 14.500zM8 5a1.5 1.5 0 1 0 0 3 1.5 1.5 0 0 0 0-3z',
  build: 'M8 1.5 14 5v6l-6 3.500L2 11V5zM2 5l6 3.500L14 5M8 8.500v6',
  back: 'M13 8H3M7 4 3 8l4 4',
  bell: 'M8 2a4 4 0 0 0-4 4c0 4-1.5 5-1.5 5h11S12 10 12 6a4 4 0 0 0-4-4zM6.5 13.500h3',
  copy: 'M5.5 5.500h8v8h-8zM10.5 5.500v-3h-8v8h3',
  pause: 'M5.5 3v10M10.5 3v10',
  play: 'M4.5 2.500v11l8.5-5.500z',
  download: 'M8 2.500V11M4.5 7.5 8 11l3.5-3.500M2 11v2.500h12V11',
} as const;

export type IconName = keyof typeof kPaths;

export function Icon({ name }: { name: IconName }) {
  return (
    <svg class="icon" viewBox="0 0 16 16" width="16" height="16" aria-hidden="true" focusable="false">
      <path d={kPaths[name]} />
    </svg>
  );
}
