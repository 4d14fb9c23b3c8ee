// The 3D view: everything that is drawn, the eye, and a loop that draws only what is new.

import type { Box3 } from 'three';
import { PerspectiveCamera, Quaternion, Raycaster, Scene, Vector2, Vector3, WebGLRenderer, Plane } from 'three';

import type { MapSummary, Pose, RobotReport, Triple } from '../api/types';
import type { Heat } from '../mesh/heat';
import type { Pieces } from '../mesh/read';
import { Controls, clamp, distanceToSee } from './controls';
import { FoundBoxes, Pointer } from './found';
import { Ground } from './ground';
import { Labels } from './labels';
import type { Quality } from './pace';
import { ALL, Pace } from './pace';
import { Robots } from './robots';
import type { Form } from './shape';
import { SlicePlane } from './slice';
import { Surface } from './surface';

/** From where all of a map is looked at. */
const OVERVIEW = { yaw: 2.25, pitch: -0.78 };
/** That are drawn at once: those of a large screen. */
const MOST_PIXELS = 3840 * 2160;
/** Between frames that show what is new, where frames take long, ms. */
const NEWS_MS = 1_000;
/** How long it is still said what was left out, ms. */
const LINGER_MS = 1_500;
/** How often it is said what is drawn while something moves, ms. */
const SAY_MS = 250;
/** Frames of one second are counted. */
const SECOND_MS = 1_000;

export interface Drawn {
  /** Of the whole surface. */
  triangles: number;
  /** While something moves; 0 while all is still. */
  framesPerSecond: number;
  /** What is drawn while something moves, where that is less, and for a moment after: share of the pixels,
   * and triangles. */
  less: { pixels: number; triangles: number } | null;
}

export class Viewer {
  readonly surface = new Surface();
  readonly robots = new Robots();
  readonly slice = new SlicePlane();
  readonly boxes = new FoundBoxes();
  readonly pointer = new Pointer();
  readonly controls: Controls;
  readonly pace: Pace;
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
  private bounds: Box3 | null = null;
  private followed: string | null = null;
  /** What stands over the view at its right and below, in pixels: the map is centred beside it. */
  private covered = { right: 0, above: 0, below: 0 };
  /** Of the view, and of what is drawn into, pixels. */
  private size = { width: 0, height: 0 };
  private buffer = '';
  /** Triangles that were drawn when something moved last. */
  private drawnMoving = 0;
  private said = 0;
  private movedAt = -Infinity;
  private news: ReturnType<typeof setTimeout> | undefined;

  constructor(
    private readonly host: HTMLElement,
    canvas: HTMLCanvasElement,
  ) {
    this.renderer = new WebGLRenderer({ canvas, antialias: false, alpha: false, powerPreference: 'high-performance' });
    this.pace = new Pace(isSoftware(this.renderer));
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

  /** The map is another one: on a slow machine a frame a second says so, and robots on it go on. */
  private invalidateSoon(): void {
    if (!this.pace.isLess || this.moving) {
      this.invalidate();
      return;
    }
    const wait = this.last + NEWS_MS - performance.now();
    this.news ??= setTimeout(() => {
      this.news = undefined;
      this.invalidate();
    }, Math.max(0, wait));
  }

  private frame(now: number): void {
    this.requested = false;
    const wasMoving = this.moving;
    const passed = now - this.last;
    this.last = now;
    // Frames that follow each other tell how fast this machine is.
    if (wasMoving) this.pace.frame(passed);
    else this.pace.begin();
    this.moving = this.controls.update(wasMoving ? Math.min(passed, 100) / 1000 : 1 / 60);
    this.draw(this.moving ? this.pace.quality : this.rest());
    this.count(now, wasMoving);
    if (this.moving) this.invalidate();
  }

  /** Everything, and as sharply as the screen is; smooth edges are for machines that have time for them. */
  private rest(): Quality {
    if (this.pace.quality.level === 0) return ALL;
    setTimeout(() => !this.moving && this.tell(performance.now()), LINGER_MS);
    return { ...ALL, pixels: Math.min(devicePixelRatio, ALL.pixels) };
  }

  private draw(quality: Quality): void {
    const { width, height } = this.size;
    if (width === 0 || height === 0) return;
    const pixels = Math.min(quality.pixels, Math.sqrt(MOST_PIXELS / (width * height)));
    const buffer = [width, height, pixels].join();
    if (buffer !== this.buffer) {
      this.buffer = buffer;
      this.renderer.setDrawingBufferSize(width, height, pixels);
      this.surface.setScale((0.5 * height * pixels) / Math.tan((this.camera.fov * Math.PI) / 360));
    }
    this.surface.setLevel(quality.level);
    this.renderer.render(this.scene, this.camera);
    this.labels.place(this.robots.places(), this.camera, this.size);
  }

  private count(now: number, wasMoving: boolean): void {
    this.recent = wasMoving ? [...this.recent.filter((at) => now - at < SECOND_MS), now] : [now];
    if (this.moving) {
      this.drawnMoving = this.surface.drawn;
      this.movedAt = now;
    }
    // What is written is drawn too.
    if (this.moving && now - this.said < SAY_MS) return;
    this.tell(now);
  }

  private tell(now: number): void {
    this.said = now;
    const span = now - (this.recent[0] ?? now);
    this.onDrawn({
      triangles: this.surface.triangles,
      framesPerSecond: this.moving && span > 200 ? ((this.recent.length - 1) * 1000) / span : 0,
      less: this.pace.isLess && now - this.movedAt < LINGER_MS ? { pixels: this.pixelShare(), triangles: this.drawnMoving } : null,
    });
  }

  /** Of the screen's own pixels. */
  private pixelShare(): number {
    return Math.min(1, this.pace.quality.pixels / Math.min(devicePixelRatio, 2)) ** 2;
  }

  private resize(): void {
    const { clientWidth: width, clientHeight: height } = this.host;
    if (width === 0 || height === 0) return;
    this.size = { width, height };
    this.robots.setSize(width, height);
    this.boxes.setSize(width, height);
    this.pointer.lines.material.resolution.set(width, height);
    this.camera.aspect = width / height;
    const { right, above, below } = this.covered;
    this.camera.setViewOffset(width, height, right / 2, (below - above) / 2, width, height);
    this.camera.updateProjectionMatrix();
    if (this.isOwn) this.fit();
    this.invalidate();
  }

  setCovered(covered: { right?: number; above?: number; below?: number }): void {
    this.covered = { ...this.covered, ...covered };
    this.resize();
  }

  setDark(dark: boolean): void {
    this.ground.setInk(dark);
    // Opaque, so that the browser need not mix it with what is behind. As `--ground` in the styles.
    this.renderer.setClearColor(dark ? '#11151c' : '#eff1f2');
    this.pointer.lines.material.color.set(dark ? '#ffffff' : '#14181f');
    this.invalidate();
  }

  take(pieces: Pieces): void {
    this.surface.take(pieces);
    const bounds = this.surface.bounds();
    if (bounds && !(this.bounds && isAlmost(bounds, this.bounds))) {
      const { min, max } = bounds;
      const reach = Math.hypot(max.x - min.x, max.y - min.y);
      this.ground.place((min.x + max.x) / 2, (min.y + max.y) / 2, Math.min(min.z, 0) - 0.02, Math.max(reach, 8));
      this.bounds = bounds;
      if (this.isOwn) this.fit();
    }
    this.invalidateSoon();
  }

  setForm(form: Form): void {
    this.surface.setForm(form);
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
    }
    const followed = this.robots.places().find(({ id }) => id === this.followed);
    if (followed) this.controls.lookAt(followed.place, this.controls.radius);
    this.invalidateSoon();
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
    if (!this.bounds || this.size.width === 0) return;
    const { min, max } = this.bounds;
    const { steep, wide } = this.free();
    const radius = clamp(distanceToSee(min, max, OVERVIEW, wide, steep) * 1.03, 1, 1_500);
    this.controls.lookAt(this.bounds.getCenter(new Vector3()), radius, OVERVIEW);
  }

  /** Half of what is seen beside what stands over the view, as tangents: from the middle to the side, and up. */
  private free(): { wide: number; steep: number } {
    const { width, height } = this.size;
    const { right, above, below } = this.covered;
    const half = Math.tan((this.camera.fov * Math.PI) / 360);
    return {
      wide: half * Math.max(0.2, (width - right) / height),
      steep: half * Math.max(0.2, (height - above - below) / height),
    };
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
    const { wide, steep } = this.free();
    const least = (1.1 * size) / Math.min(wide, steep);
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

/** Whether two boxes differ too little to look from elsewhere: a map that is learned is never quite still. */
function isAlmost(one: Box3, other: Box3): boolean {
  const most = 0.02 * one.min.distanceTo(one.max);
  return one.min.distanceTo(other.min) < most && one.max.distanceTo(other.max) < most;
}

/** Whether the processor draws. */
function isSoftware(renderer: WebGLRenderer): boolean {
  const gl = renderer.getContext();
  const named = gl.getExtension('WEBGL_debug_renderer_info');
  const name: unknown = gl.getParameter(named ? named.UNMASKED_RENDERER_WEBGL : gl.RENDERER);
  return /swiftshader|llvmpipe|software|basic render/i.test(String(name));
}
