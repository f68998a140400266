/** The largest of 1, 2 and 5 times a power of ten that is at most `most`. */
export function roundBelow(most: number): number {
  const power = 10 ** Math.floor(Math.log10(most));
  return [5, 2, 1].map((times) => times * power).find((value) => value <= most) ?? power;
}
