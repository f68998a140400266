import * as THREE from 'three';
import { OrbitControls } from 'three/examples/jsm/controls/OrbitControls.js';
import { Line2 } from 'three/examples/jsm/lines/Line2.js';
import { LineGeometry } from 'three/examples/jsm/lines/LineGeometry.js';
import { LineMaterial } from 'three/examples/jsm/lines/LineMaterial.js';
import type { Theme } from './colour.js';
import { fitView } from './fit.js';
import { steer } from './keyboard.js';
import { PointMaterials } from './points.js';
import { kLayers, type TilePoints } from './tile.js';

/** Everything that can be switched in the picture. */
export type Part = 'measured' | 'ground' | 'projected' | 'trajectory' | 'objects';
export const kParts: readonly Part[] = ['measured', 'ground', 'projected', 'trajectory', 'objects'];

const kColours: Record<Theme, { background: number; trajectory: number; objects: number }> = {
  dark: { background: 0x10141a, trajectory: 0xffffff, objects: 0xff7ac8 },
  light: { background: 0xf5f6f8, trajectory: 0x14181f, objects: 0xc81480 },
};
const kElevation = (50 * Math.PI) / 180;
const kFovDeg = 45;

/**
 * Draws one map on a canvas; coordinates are metres relative to the map's origin, z up.
 *
 * Draws only when something changed. The constructor throws when the browser has no WebGL 2.
 */
export class Viewer {
  private readonly renderer_: THREE.WebGLRenderer;
  private readonly scene_ = new THREE.Scene();
  private readonly camera_ = new THREE.PerspectiveCamera(kFovDeg, 1, 0.1, 1000);
  private readonly controls_: OrbitControls;
  private readonly points_: PointMaterials;
  private readonly line_ = new LineMaterial({ linewidth: 3, depthTest: false, transparent: true, opacity: 0.9 });
  private readonly edges_ = new THREE.LineBasicMaterial({ transparent: true, opacity: 0.55 });
  private readonly groups_: Record<Part, THREE.Group>;
  private corners_: [number, number, number][] = [];
  private voxelSizeM_ = 0.1;
  private drawPending_ = false;

  constructor(
    private readonly canvas_: HTMLCanvasElement,
    theme: Theme,
  ) {
    this.renderer_ = new THREE.WebGLRenderer({ canvas: canvas_, antialias: true });
    this.points_ = new PointMaterials(theme);
    const group = (): THREE.Group => new THREE.Group();
    this.groups_ = {
      measured: group(), ground: group(), projected: group(), trajectory: group(), objects: group(),
    };
    this.scene_.add(...Object.values(this.groups_));
    this.camera_.up.set(0, 0, 1);
    this.controls_ = new OrbitControls(this.camera_, canvas_);
    // Never from below the ground.
    this.controls_.maxPolarAngle = 0.495 * Math.PI;
    this.controls_.zoomToCursor = true;
    this.controls_.addEventListener('change', () => this.draw());
    canvas_.addEventListener('keydown', (event) => this.onKey(event));
    new ResizeObserver(() => this.resize()).observe(canvas_);
    this.setTheme(theme);
    this.resize();
  }

  /** Drops the map shown, and looks at where the next one will be. @param corners of all its tiles. */
  begin(corners: [number, number, number][], voxelSizeM: number): void {
    for (const group of Object.values(this.groups_)) {
      for (const child of group.children) (child as THREE.Points | THREE.LineSegments).geometry.dispose();
      group.clear();
    }
    this.corners_ = corners;
    this.voxelSizeM_ = voxelSizeM;
    this.showAll();
  }

  addTile(tile: TilePoints): void {
    for (const layer of kLayers) {
      if (tile[layer].length === 0) continue;
      const points = new THREE.Points(geometryOf(tile[layer]), this.points_.byLayer[layer]);
      points.matrixAutoUpdate = false;
      this.groups_[layer].add(points);
    }
    this.draw();
  }

  /** @param positions x, y, z one after the other; a line needs two. */
  setTrajectory(positions: Float32Array): void {
    if (positions.length < 6) return;
    const line = new Line2(new LineGeometry().setPositions(positions), this.line_);
    // Above the points, so that it can be followed under trees and bridges.
    line.renderOrder = 1;
    this.groups_.trajectory.add(line);
    this.draw();
  }

  /** @param ends both ends of every edge, as boxEdges returns them. */
  setObjects(ends: Float32Array): void {
    if (ends.length > 0) this.groups_.objects.add(new THREE.LineSegments(geometryOf(ends), this.edges_));
    this.draw();
  }

  setVisible(part: Part, visible: boolean): void {
    this.groups_[part].visible = visible;
    this.draw();
  }

  setHeightRange(low: number, high: number): void {
    this.points_.setHeightRange(low, high);
    this.draw();
  }

  setTheme(theme: Theme): void {
    this.points_.setTheme(theme);
    this.renderer_.setClearColor(kColours[theme].background);
    this.line_.color.set(kColours[theme].trajectory);
    this.edges_.color.set(kColours[theme].objects);
    this.draw();
  }

  /** From above at an angle, with the whole map in the picture. */
  showAll(): void {
    this.look(kElevation);
  }

  /** Straight down. */
  showFromAbove(): void {
    // Not quite 90 degrees: there "up" would have no direction.
    this.look(0.4999 * Math.PI);
  }

  private look(elevation: number): void {
    if (this.corners_.length === 0) return;
    const view = fitView(this.corners_, (kFovDeg * Math.PI) / 180, this.camera_.aspect, elevation);
    this.camera_.position.set(...view.eye);
    this.controls_.target.set(...view.target);
    const distance = this.camera_.position.distanceTo(this.controls_.target);
    this.camera_.near = distance / 2000;
    this.camera_.far = distance * 10;
    this.controls_.minDistance = 2;
    this.controls_.maxDistance = distance * 4;
    this.camera_.updateProjectionMatrix();
    this.controls_.update();
    this.draw();
  }

  private onKey(event: KeyboardEvent): void {
    const move = steer(event);
    if (move === undefined) return;
    event.preventDefault();
    if (move === 'all') return this.showAll();
    if (move === 'above') return this.showFromAbove();
    move(this.camera_, this.controls_.target, this.controls_);
    this.controls_.update();
    this.draw();
  }

  private resize(): void {
    const [width, height] = [this.canvas_.clientWidth, this.canvas_.clientHeight];
    if (width === 0 || height === 0) return;
    const ratio = Math.min(window.devicePixelRatio, 2);
    this.renderer_.setPixelRatio(ratio);
    this.renderer_.setSize(width, height, false);
    this.camera_.aspect = width / height;
    this.camera_.updateProjectionMatrix();
    this.draw();
  }

  private draw(): void {
    if (this.drawPending_) return;
    this.drawPending_ = true;
    requestAnimationFrame(() => {
      this.drawPending_ = false;
      const pixelsPerRadian = this.canvas_.height / (2 * Math.tan((kFovDeg * Math.PI) / 360));
      this.points_.setSize(this.voxelSizeM_, pixelsPerRadian, this.renderer_.getPixelRatio());
      this.renderer_.render(this.scene_, this.camera_);
    });
  }
}

function geometryOf(positions: Float32Array): THREE.BufferGeometry {
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute('position', new THREE.BufferAttribute(positions, 3));
  geometry.computeBoundingSphere();
  return geometry;
}
