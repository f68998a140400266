/** Points of one side of a difference, of the map or of one tile. */
export interface Side {
  points: number;
  kinds: Partial<Record<'measured' | 'ground' | 'projected' | 'filled', number>>;
  area_m2: number;
  /** Of the points, those at places that the other version saw free. */
  seen_free: number;
}

export interface TileSide extends Side {
  min: [number, number, number];
  max: [number, number, number];
  url: string;
}

export interface DifferenceTile {
  x: number;
  y: number;
  only_in_version: TileSide | null;
  only_in_other: TileSide | null;
}

/** Answer of `GET .../difference/{other}`; coordinates relative to `origin`, that of `version`. */
export interface Difference {
  state: 'ready';
  tolerance_m: number;
  origin: [number, number, number];
  only_in_version: Side;
  only_in_other: Side;
  tiles: DifferenceTile[];
}

/** A place of the map where much has changed. */
export interface Place {
  /** Bounds of the differences, relative to the origin of the difference [m]. */
  min: [number, number, number];
  max: [number, number, number];
  onlyInVersion_m2: number;
  onlyInOther_m2: number;
}

const areaOf = (tile: DifferenceTile): number => (tile.only_in_version?.area_m2 ?? 0) + (tile.only_in_other?.area_m2 ?? 0);

/** Differences in two tiles belong together if they are at most this far apart [m]. */
const kGap_m = 5;

/**
 * The places that changed most, largest first. A place is the tile with the largest changed area, and those of its eight
 * neighbours whose changes are near. The next place starts from the tiles that are left. So no place is wider than three tiles.
 */
export function biggestPlaces(tiles: readonly DifferenceTile[], most: number): Place[] {
  const left = new Map(tiles.map((tile) => [`${tile.x}/${tile.y}`, tile]));
  const places: Place[] = [];
  for (const tile of [...tiles].sort((a, b) => areaOf(b) - areaOf(a))) {
    if (places.length === most) break;
    if (!left.delete(`${tile.x}/${tile.y}`) || areaOf(tile) === 0) continue;
    const own = placeOf([tile]);
    const near = around(tile).flatMap((key) => left.get(key) ?? []).filter((other) => gap(own, placeOf([other])) <= kGap_m);
    for (const { x, y } of near) left.delete(`${x}/${y}`);
    places.push(placeOf([tile, ...near]));
  }
  return places.sort((a, b) => b.onlyInVersion_m2 + b.onlyInOther_m2 - a.onlyInVersion_m2 - a.onlyInOther_m2);
}

function around({ x, y }: DifferenceTile): string[] {
  const steps = [-1, 0, 1];
  return steps.flatMap((dx) => steps.flatMap((dy) => (dx === 0 && dy === 0 ? [] : [`${x + dx}/${y + dy}`])));
}

/** Horizontal distance [m]; 0 if they overlap. */
function gap(a: Place, b: Place): number {
  const apart = (axis: 0 | 1): number => Math.max(0, a.min[axis] - b.max[axis], b.min[axis] - a.max[axis]);
  return Math.hypot(apart(0), apart(1));
}

function placeOf(tiles: readonly DifferenceTile[]): Place {
  const place: Place = {
    min: [Infinity, Infinity, Infinity],
    max: [-Infinity, -Infinity, -Infinity],
    onlyInVersion_m2: 0,
    onlyInOther_m2: 0,
  };
  for (const tile of tiles) {
    place.onlyInVersion_m2 += tile.only_in_version?.area_m2 ?? 0;
    place.onlyInOther_m2 += tile.only_in_other?.area_m2 ?? 0;
    for (const side of [tile.only_in_version, tile.only_in_other]) {
      if (side === null) continue;
      for (const axis of [0, 1, 2] as const) {
        place.min[axis] = Math.min(place.min[axis], side.min[axis]);
        place.max[axis] = Math.max(place.max[axis], side.max[axis]);
      }
    }
  }
  return place;
}

const kKindWords = { measured: 'measured', ground: 'ground', projected: 'projected', filled: 'filled' } as const;

/** `1,234 points on 87 m²: 1,000 measured, 234 ground; 900 where the other map saw free space`; what has no points is
 * left out. */
export function sideWords(side: Side): string {
  const count = (value: number): string => value.toLocaleString('en');
  if (side.points === 0) return 'nothing';
  const kinds = Object.entries(kKindWords).flatMap(([kind, word]) => {
    const points = side.kinds[kind as keyof typeof kKindWords] ?? 0;
    return points === 0 ? [] : [`${count(points)} ${word}`];
  });
  const free = side.seen_free === 0 ? '' : `; ${count(side.seen_free)} where the other map saw free space`;
  return `${count(side.points)} points on ${count(Math.round(side.area_m2))} m²: ${kinds.join(', ')}${free}`;
}
