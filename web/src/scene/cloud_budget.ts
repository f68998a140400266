import type { Tile } from '3d-tiles-renderer/core';
import type { TilesRenderer } from '3d-tiles-renderer/three';
import { errorForBudget, type BudgetTile } from './budget.js';
import { levelOf } from './tile_points.js';

/** Error [px] below which no finer tiles are requested: a point per pixel is enough. */
const kFinestPx = 1.2;

/** The part of a stillmap tileset that says how many points each level has. */
export interface CountedTileset {
  readonly asset: { version: string };
  readonly extras?: { readonly points?: readonly number[] };
  readonly root: CountedTile;
}

interface CountedTile {
  readonly content?: { readonly uri?: string };
  readonly children?: readonly CountedTile[];
}

interface BudgetTree extends BudgetTile {
  readonly tile: Tile;
  readonly children: readonly BudgetTree[];
}

/** Calls of the library that are documented for plugins, but not declared. */
interface ViewErrors {
  prepareForTraversal(): void;
  calculateTileViewError(tile: Tile, target: { inView: boolean; error: number; distanceFromCamera: number }): void;
}

/** Finds how coarse the tiles of a cloud must be for a budget of points. */
export class CloudBudget {
  /** Points of a tile, on average over its level. */
  private readonly usual_: readonly number[];
  private readonly trees_ = new WeakMap<Tile, BudgetTree>();

  /** @param countOf points of a loaded tile; for others the average of their level is used. */
  constructor(tileset: CountedTileset, private readonly countOf_: (tile: Tile) => number | undefined) {
    const tiles: number[] = [];
    const count = ({ content, children = [] }: CountedTile): void => {
      const level = content?.uri === undefined ? -1 : levelOf({ content } as Tile);
      if (level >= 0) tiles[level] = (tiles[level] ?? 0) + 1;
      children.forEach(count);
    };
    count(tileset.root);
    this.usual_ = (tileset.extras?.points ?? []).map((points, level) => points / (tiles[level] ?? Infinity));
  }

  /** The error [px] for the renderer with its present camera. */
  errorTarget(tiles: TilesRenderer, budget: number): number {
    if (tiles.root === null) return kFinestPx;
    const errors = tiles as unknown as ViewErrors;
    const seen = { inView: false, error: Infinity, distanceFromCamera: Infinity };
    errors.prepareForTraversal();
    const errorOf = ({ tile }: BudgetTree): number | undefined => {
      // Not prepared by the library yet.
      if ((tile as { traversal?: object }).traversal === undefined) return undefined;
      errors.calculateTileViewError(tile, seen);
      return seen.inView ? seen.error : undefined;
    };
    return errorForBudget(this.treeOf(tiles.root as Tile), errorOf, budget, kFinestPx);
  }

  // The library's tree in the form that the budget needs. Nested tilesets are loaded later, so children are read each time.
  private treeOf(tile: Tile): BudgetTree {
    const known = this.trees_.get(tile);
    if (known !== undefined) return known;
    const hasPoints = (tile.content as { uri?: string } | undefined)?.uri?.endsWith('.glb') === true;
    const points = (): number => (hasPoints ? this.countOf_(tile) ?? this.usual_[levelOf(tile)] ?? 0 : 0);
    const children = (): BudgetTree[] => ((tile.children ?? []) as Tile[]).map((child) => this.treeOf(child));
    const tree = {
      tile,
      get points() {
        return points();
      },
      get children() {
        return children();
      },
    };
    this.trees_.set(tile, tree);
    return tree;
  }
}
