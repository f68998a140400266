import * as THREE from 'three';
import { headingOf, type Pose, type Vec3 } from './pose.js';
import { freeDirection, uncertaintyOf } from './uncertainty.js';
import { matrixAt } from './scan_cloud.js';
import { magnification } from './magnification.js';
import { kSigmas } from './sigmas.js';

const kEllipseSteps = 96;
const kDirection_m = 8;
/** Least size of a vehicle's mark in the picture [px], and its length [m]. */
const kLeastMark_px = 26;
const kMark_m = 4.4;
/** Size of the rim around it, as a share of its own. */
const kRim = 1.3;

/** A flat arrow for a vehicle's position and heading; never too small to be seen. */
export class VehicleMark {
  readonly object = new THREE.Group();
  private readonly fill = flatMaterial();
  /** The rim separates the arrow from any ground. */
  private readonly rim = flatMaterial();

  constructor(private readonly origin: Vec3) {
    const parts = [[kRim, this.rim, 10], [1, this.fill, 11]] as const;
    for (const [scale, material, order] of parts) {
      const mesh = new THREE.Mesh(arrowShape(scale), material);
      mesh.renderOrder = order;
      mesh.frustumCulled = false;
      mesh.onBeforeRender = (renderer, _scene, camera) => this.resize(mesh, renderer, camera);
      this.object.add(mesh);
    }
  }

  show(pose: Pose, colour: THREE.Color, opacity: number): void {
    this.object.position.setFromMatrixPosition(matrixAt(pose, this.origin));
    this.object.rotation.set(0, 0, headingOf(pose));
    this.fill.color.copy(colour);
    for (const material of [this.fill, this.rim]) material.opacity = opacity;
  }

  dispose(): void {
    disposeMarks(this.object);
  }

  // At least this many pixels long at its distance.
  private resize(mesh: THREE.Object3D, renderer: THREE.WebGLRenderer, camera: THREE.Camera): void {
    const height = renderer.getSize(new THREE.Vector2()).y;
    const away = -this.object.position.clone().applyMatrix4(camera.matrixWorldInverse).z;
    const pixel_m = (2 * Math.max(0.1, away)) / camera.projectionMatrix.elements[5]! / height;
    mesh.scale.setScalar(Math.max(kMark_m, kLeastMark_px * pixel_m));
    mesh.updateMatrixWorld();
  }
}

function arrowShape(scale: number): THREE.ShapeGeometry {
  const corners = [[0.5, 0], [-0.5, 0.36], [-0.28, 0], [-0.5, -0.36]] as const;
  // About the middle of the arrow, so that the rim is even.
  return new THREE.ShapeGeometry(new THREE.Shape(corners.map(([x, y]) => new THREE.Vector2(scale * (x + 0.1) - 0.1, scale * y))));
}

function flatMaterial(): THREE.MeshBasicMaterial {
  return new THREE.MeshBasicMaterial({ color: 0xffffff, side: THREE.DoubleSide, depthTest: false, transparent: true });
}

/** Ellipse of a pose's covariance (horizontal, 3 sigma), and arrows along unconstrained directions. */
export function uncertaintyMarks(
  pose: Pose, covariance: readonly number[], degenerate: readonly (readonly number[])[], origin: Vec3,
  colours: { ellipse: THREE.Color; free: THREE.Color },
): THREE.Group {
  const group = new THREE.Group();
  group.position.setFromMatrixPosition(matrixAt(pose, origin));
  const { major_m, minor_m, angle_rad } = uncertaintyOf(pose, covariance);
  const scale = kSigmas * magnification(major_m);
  const ellipse = new THREE.EllipseCurve(0, 0, scale * major_m, scale * minor_m, 0, 2 * Math.PI, false, angle_rad);
  group.add(overlay(new THREE.LineLoop(
    new THREE.BufferGeometry().setFromPoints(ellipse.getPoints(kEllipseSteps)),
    new THREE.LineBasicMaterial({ color: colours.ellipse }))));
  group.add(overlay(new THREE.Mesh(
    new THREE.ShapeGeometry(new THREE.Shape(ellipse.getPoints(kEllipseSteps))),
    new THREE.MeshBasicMaterial({ color: colours.ellipse, opacity: 0.25, side: THREE.DoubleSide }))));
  for (const direction of degenerate) {
    const { slide } = freeDirection(pose, direction);
    if (slide.length() < 0.3) continue;
    for (const sign of [1, -1]) {
      const along = slide.clone().normalize().multiplyScalar(sign);
      const arrow = new THREE.ArrowHelper(along, new THREE.Vector3(), kDirection_m, colours.free, 1.4, 0.9);
      arrow.traverse((part) => overlay(part));
      group.add(arrow);
    }
  }
  return group;
}

/** The found path of a drive, with gaps where it was lost. */
export function pathLine(poses: readonly (Pose | null)[], origin: Vec3, colour: THREE.Color): THREE.LineSegments {
  const points: THREE.Vector3[] = [];
  poses.forEach((pose, i) => {
    const before = poses[i - 1];
    if (pose === null || before === null || before === undefined) return;
    for (const end of [before, pose]) points.push(new THREE.Vector3().setFromMatrixPosition(matrixAt(end, origin)));
  });
  const geometry = new THREE.BufferGeometry().setFromPoints(points);
  return overlay(new THREE.LineSegments(geometry, new THREE.LineBasicMaterial({ color: colour })));
}

/** Removes a group from the picture and frees its memory on the graphics card. */
export function disposeMarks(group: THREE.Object3D): void {
  group.removeFromParent();
  group.traverse((part) => {
    if (!('geometry' in part)) return;
    (part as THREE.Mesh).geometry.dispose();
    const { material } = part as THREE.Mesh;
    for (const one of Array.isArray(material) ? material : [material]) one.dispose();
  });
}

/** Drawn over everything, so that no wall hides a mark. */
function overlay<Part extends THREE.Object3D>(part: Part): Part {
  part.renderOrder = 9;
  part.frustumCulled = false;
  const { material } = part as unknown as Partial<THREE.Mesh>;
  for (const one of material === undefined ? [] : Array.isArray(material) ? material : [material]) {
    one.depthTest = false;
    one.transparent = true;
  }
  return part;
}
