// The 3D view: everything that is drawn, the eye, and a loop that draws only what is new.

import { PerspectiveCamera, Quaternion, Raycaster, Scene, Vector2, Vector3, WebGLRenderer, Plane } from 'three';

import type { MapSummary, Pose, RobotReport, Triple } from '../api/types';
import type { Heat } from '../mesh/heat';
import type { Pieces } from '../mesh/read';
import { Controls, clamp } from './controls';
import { FoundBoxes, Pointer } from './found';
import { Ground } from './ground';
import { Labels } from './labels';
import { Pace } from './pace';
import { Robots } from './robots';
import { SlicePlane } from './slice';
import { Surface } from './surface';

/** Frames of one second are counted. */
const SECOND_MS = 1_000;

export interface Drawn {
  triangles: number;
  pieces: number;
  /** While something moves; 0 while all is still. */
  framesPerSecond: number;
  /** What is drawn less of. */
  less: string;
}

export class Viewer {
  readonly surface = new Surface();
  readonly robots = new Robots();
  readonly slice = new SlicePlane();
  readonly boxes = new FoundBoxes();
  readonly pointer = new Pointer();
  readonly controls: Controls;
  readonly pace = new Pace();
  onDrawn: (drawn: Drawn) => void = () => undefined;

  private readonly scene = new Scene();
  private readonly camera = new PerspectiveCamera(55, 1, 0.05, 400);
  private readonly renderer: WebGLRenderer;
  private readonly ground = new Ground();
  private readonly labels: Labels;
  private readonly ray = new Raycaster();
  private last = 0;
  private moving = false;
  private requested = false;
  private recent: number[] = [];
  /** Until a person takes the eye, it keeps all of the map in view. */
  private isOwn = true;
  private bounds: MapSummary['bounds'] = null;
  private followed: string | null = null;
  /** What stands over the view at its right and below, in pixels: the map is centred beside it. */
  private covered = { right: 0, below: 0 };

  constructor(
    private readonly host: HTMLElement,
    canvas: HTMLCanvasElement,
  ) {
    this.renderer = new WebGLRenderer({ canvas, antialias: true, alpha: true, powerPreference: 'high-performance' });
    this.renderer.setClearAlpha(0);
    this.controls = new Controls(this.camera, canvas);
    this.controls.onMove = () => this.invalidate();
    this.controls.onTouched = () => {
      this.isOwn = false;
      this.followed = null;
    };
    this.labels = new Labels(host);
    this.scene.add(this.ground.mesh, this.surface.group, this.robots.group);
    this.scene.add(this.slice.mesh, this.boxes.group, this.pointer.lines);
    new ResizeObserver(() => this.resize()).observe(host);
    this.resize();
  }

  /** Something is to be drawn. */
  invalidate(): void {
    if (this.requested) return;
    this.requested = true;
    requestAnimationFrame((now) => this.frame(now));
  }

  private frame(now: number): void {
    this.requested = false;
    const wasMoving = this.moving;
    const passed = now - this.last;
    this.last = now;
    // Frames that follow each other tell how fast this machine is.
    if (wasMoving && this.pace.frame(passed)) this.resize();
    this.moving = this.controls.update(wasMoving ? Math.min(passed, 100) / 1000 : 1 / 60);
    this.surface.thin(this.moving ? this.pace.quality.pieces : 1, this.camera.position);
    this.renderer.render(this.scene, this.camera);
    this.labels.place(this.robots.places(), this.camera, this.host);
    this.count(now, wasMoving);
    if (this.moving) this.invalidate();
  }

  private count(now: number, wasMoving: boolean): void {
    this.recent = wasMoving ? [...this.recent.filter((at) => now - at < SECOND_MS), now] : [now];
    const span = now - (this.recent[0] ?? now);
    this.onDrawn({
      triangles: this.surface.triangles,
      pieces: this.surface.pieces,
      framesPerSecond: this.moving && span > 200 ? ((this.recent.length - 1) * 1000) / span : 0,
      less: this.pace.says,
    });
  }

  private resize(): void {
    const { clientWidth: width, clientHeight: height } = this.host;
    if (width === 0 || height === 0) return;
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2) * this.pace.quality.pixels);
    this.renderer.setSize(width, height, false);
    this.robots.setSize(width, height);
    this.boxes.setSize(width, height);
    this.pointer.lines.material.resolution.set(width, height);
    this.camera.aspect = width / height;
    const { right, below } = this.covered;
    this.camera.setViewOffset(width, height, right / 2, below / 2, width, height);
    this.camera.updateProjectionMatrix();
    if (this.isOwn) this.fit();
    this.invalidate();
  }

  setCovered(covered: { right?: number; below?: number }): void {
    this.covered = { ...this.covered, ...covered };
    this.resize();
  }

  setDark(dark: boolean): void {
    this.ground.setInk(dark);
    this.pointer.lines.material.color.set(dark ? '#ffffff' : '#14181f');
    this.invalidate();
  }

  take(pieces: Pieces): void {
    this.surface.take(pieces);
    this.invalidate();
  }

  setHeat(heat: Heat | null): void {
    this.surface.setHeat(heat);
    this.invalidate();
  }

  /** What the counters say of places. */
  update(map: MapSummary, robots: RobotReport[]): void {
    this.robots.update(robots);
    if (!map.bounds) {
      this.bounds = null;
      this.slice.show(null);
    } else {
      const isNew = JSON.stringify(map.bounds) !== JSON.stringify(this.bounds);
      this.bounds = map.bounds;
      const { min, max } = map.bounds;
      this.surface.setHeights(min[2], max[2]);
      const reach = Math.hypot(max[0] - min[0], max[1] - min[1]);
      this.ground.place((min[0] + max[0]) / 2, (min[1] + max[1]) / 2, Math.min(min[2], 0) - 0.02, Math.max(reach, 8));
      if (isNew && this.isOwn) this.fit();
    }
    const followed = this.robots.places().find(({ id }) => id === this.followed);
    if (followed) this.controls.lookAt(followed.place, this.controls.radius);
    this.invalidate();
  }

  /** Nothing is known of this map yet. */
  clear(): void {
    this.surface.clear();
    this.robots.clear();
    this.boxes.clear();
    this.slice.show(null);
    this.pointer.hide();
    this.surface.setHeat(null);
    this.bounds = null;
    this.isOwn = true;
    this.followed = null;
    this.invalidate();
  }

  /** All of the map in view, from above. */
  fit(): void {
    if (!this.bounds) return;
    const [min, max] = [new Vector3(...this.bounds.min), new Vector3(...this.bounds.max)];
    const size = max.clone().sub(min);
    const half = Math.tan((this.camera.fov * Math.PI) / 360) * Math.min(1, (this.camera.aspect * (this.host.clientWidth - this.covered.right)) / this.host.clientWidth);
    const radius = clamp((0.5 * Math.hypot(size.x, size.y, size.z * 0.6)) / half, 1, 1_500) * 0.98;
    this.controls.lookAt(min.add(max).multiplyScalar(0.5), radius, { yaw: 2.25, pitch: -0.78 });
  }

  /** The eye stays with a robot until a person moves it. */
  follow(robotId: string | null): void {
    this.followed = robotId;
    this.isOwn = false;
    const found = this.robots.places().find(({ id }) => id === robotId);
    if (found) this.controls.lookAt(found.place, Math.min(this.controls.radius, 4));
  }

  get following(): string | null {
    return this.followed;
  }

  /** Goes to where a camera stood. */
  standAt(pose: Pose, target: Triple | null): void {
    this.isOwn = false;
    this.followed = null;
    const eye = new Vector3(...pose.translation);
    const ahead = new Vector3(0, 0, 1).applyQuaternion(new Quaternion(...pose.rotation)).multiplyScalar(1.5);
    this.controls.standAt(eye, target ? new Vector3(...target) : eye.clone().add(ahead));
  }

  /** A thing of some size in view, from where a camera saw it, or farther away on the same line. */
  see(center: Triple, size: number, from: Pose | null): void {
    this.isOwn = false;
    this.followed = null;
    const target = new Vector3(...center);
    const { clientWidth: width, clientHeight: height } = this.host;
    const free = Math.min((width - this.covered.right) / height, (height - this.covered.below) / height);
    const least = (1.1 * size) / Math.tan((this.camera.fov * Math.PI) / 360) / Math.max(free, 0.3);
    if (!from) {
      this.controls.lookAt(target, Math.max(least, 1));
      return;
    }
    const way = new Vector3(...from.translation).sub(target);
    const eye = target.clone().addScaledVector(way.clone().normalize(), Math.max(way.length(), least));
    this.controls.standAt(eye, target);
  }

  /** Where the eye is, as the server has cameras: x right, y down, z forward. */
  pose(): Pose {
    this.camera.updateMatrixWorld();
    const turned = new Quaternion().setFromAxisAngle(new Vector3(1, 0, 0), Math.PI);
    const rotation = this.camera.quaternion.clone().multiply(turned).normalize();
    return {
      translation: this.camera.position.toArray(),
      rotation: [rotation.x, rotation.y, rotation.z, rotation.w],
    };
  }

  get fieldOfView(): number {
    return this.camera.fov;
  }

  get aspect(): number {
    return this.camera.aspect;
  }

  /** The ray under a place of the screen. */
  rayAt(clientX: number, clientY: number): { origin: Triple; direction: Triple } {
    const box = this.host.getBoundingClientRect();
    const x = ((clientX - box.left) / box.width) * 2 - 1;
    const y = 1 - ((clientY - box.top) / box.height) * 2;
    this.ray.setFromCamera(new Vector2(x, y), this.camera);
    const { origin, direction } = this.ray.ray;
    return { origin: origin.toArray(), direction: direction.toArray() };
  }

  /** Where that ray meets a height. */
  atHeight(clientX: number, clientY: number, z: number): Triple | null {
    this.rayAt(clientX, clientY);
    const met = this.ray.ray.intersectPlane(new Plane(new Vector3(0, 0, 1), -z), new Vector3());
    return met ? met.toArray() : null;
  }
}
