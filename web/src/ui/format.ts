// Numbers and times as people read them. English, SI, the same everywhere on the page.

const kNumber = new Intl.NumberFormat('en-GB');
const kDateTime = new Intl.DateTimeFormat('en-GB', { dateStyle: 'medium', timeStyle: 'short' });

export function number(value: number, digits?: number): string {
  if (digits === undefined) return kNumber.format(value);
  return new Intl.NumberFormat('en-GB', { minimumFractionDigits: digits, maximumFractionDigits: digits }).format(value);
}

/** 1234567 as "1.2 M". */
export function short(value: number): string {
  const steps: [number, string][] = [[1e9, 'G'], [1e6, 'M'], [1e3, 'k']];
  for (const [size, unit] of steps) if (Math.abs(value) >= size) return `${three(value / size)} ${unit}`;
  return three(value);
}

/** In powers of 1000, as disks and networks count: "12.3 MB". */
export function bytes(value: number): string {
  const units = ['B', 'kB', 'MB', 'GB', 'TB', 'PB'];
  let size = value;
  let unit = 0;
  while (Math.abs(size) >= 999.5 && unit < units.length - 1) {
    size /= 1000;
    unit += 1;
  }
  return `${unit === 0 ? Math.round(size) : three(size)} ${units[unit]}`;
}

/** @param value [m^2]: "820 m²", "1.2 ha", "3.4 km²". */
export function area(value: number): string {
  if (value >= 1e6) return `${three(value / 1e6)} km²`;
  if (value >= 1e4) return `${three(value / 1e4)} ha`;
  return `${three(value)} m²`;
}

function three(value: number): string {
  const size = Math.abs(value);
  return number(value, size >= 99.95 || Number.isInteger(value) ? 0 : size >= 9.995 ? 1 : size >= 1 ? 1 : 2);
}

/** @param value [s]: "8 s", "3 min 20 s", "2 h 5 min", "4 d 3 h". */
export function duration(value: number): string {
  const seconds = Math.max(0, Math.round(value));
  if (seconds < 60) return value > 0 && value < 9.95 && !Number.isInteger(value) ? `${three(value)} s` : `${seconds} s`;
  const parts: [number, string][] = [[86_400, 'd'], [3600, 'h'], [60, 'min'], [1, 's']];
  const first = parts.findIndex(([size]) => seconds >= size);
  const [size, unit] = parts[first] ?? [1, 's'];
  const [nextSize, nextUnit] = parts[first + 1] ?? [1, 's'];
  const next = Math.floor((seconds % size) / nextSize);
  return `${Math.floor(seconds / size)} ${unit}${next > 0 ? ` ${next} ${nextUnit}` : ''}`;
}

/** @param ns since 1970 [ns], decimal as the server sends it. */
export function toDate(ns: string): Date {
  return new Date(Number(BigInt(ns) / 1_000_000n));
}

/** "22 Nov 2026, 14:05". */
export function date(ns: string): string {
  return kDateTime.format(toDate(ns));
}

/** "3 min ago". */
export function age(ns: string, now: Date = new Date()): string {
  const seconds = (now.getTime() - toDate(ns).getTime()) / 1000;
  if (seconds < 5) return 'just now';
  if (seconds < 60) return `${Math.floor(seconds)} s ago`;
  const steps: [number, string][] = [[365 * 86_400, 'year'], [30 * 86_400, 'month'], [86_400, 'day'], [3600, 'h'], [60, 'min']];
  const [size, unit] = steps.find(([step]) => seconds >= step) ?? [60, 'min'];
  const count = Math.floor(seconds / size);
  return `${count} ${unit}${count > 1 && unit.length > 3 ? 's' : ''} ago`;
}

export function plural(count: number, one: string, many = `${one}s`): string {
  return `${number(count)} ${count === 1 ? one : many}`;
}

export function firstUpper(text: string): string {
  return text.charAt(0).toUpperCase() + text.slice(1);
}
