// Where the eye is and how it moves: around a place, or freely; by mouse, touch and keys.

import type { PerspectiveCamera} from 'three';
import { Vector3 } from 'three';

export type Mode = 'orbit' | 'fly';

const NEAREST_M = 0.05;
const FARTHEST_M = 2_000;
const STEEPEST = Math.PI / 2 - 0.02;
/** Share of the way to where it should be that is left after a second. */
const LEFT_AFTER_SECOND = 1e-5;
/** Radians a pixel. */
const TURN = 0.0055;

/** Radians: round the up axis, and up. */
export interface Turned {
  yaw: number;
  pitch: number;
}

interface Stand extends Turned {
  target: Vector3;
  radius: number;
}

export class Controls {
  mode: Mode = 'orbit';
  /** Called whenever something is to be drawn. */
  onMove: () => void = () => undefined;
  /** Called once a person moved the eye. */
  onTouched: () => void = () => undefined;
  /** Called for a press and release in one place. */
  onTap: (x: number, y: number) => void = () => undefined;

  private readonly goal: Stand = { target: new Vector3(), yaw: 0.7, pitch: -0.6, radius: 8 };
  private readonly now: Stand = { target: new Vector3(), yaw: 0.7, pitch: -0.6, radius: 8 };
  private readonly pointers = new Map<number, { x: number; y: number }>();
  private readonly held = new Set<string>();
  private travelled = 0;

  constructor(
    private readonly camera: PerspectiveCamera,
    private readonly element: HTMLElement,
  ) {
    camera.up.set(0, 0, 1);
    element.addEventListener('pointerdown', (event) => this.down(event));
    element.addEventListener('pointermove', (event) => this.move(event));
    element.addEventListener('pointerup', (event) => this.up(event));
    element.addEventListener('pointercancel', (event) => this.pointers.delete(event.pointerId));
    element.addEventListener('wheel', (event) => this.wheel(event), { passive: false });
    element.addEventListener('contextmenu', (event) => event.preventDefault());
    element.addEventListener('keydown', (event) => this.key(event));
    element.addEventListener('keyup', (event) => this.held.delete(event.code));
    element.addEventListener('blur', () => this.held.clear());
  }

  get target(): Vector3 {
    return this.goal.target;
  }

  get radius(): number {
    return this.goal.radius;
  }

  /** Looks at a place from a distance, from where it looks now or along `from`. */
  lookAt(target: Vector3, radius: number, from?: Turned): void {
    this.goal.target.copy(target);
    this.goal.radius = clamp(radius, NEAREST_M, FARTHEST_M);
    if (from) {
      // The short way round.
      const turns = Math.round((this.now.yaw - from.yaw) / (2 * Math.PI));
      this.goal.yaw = from.yaw + turns * 2 * Math.PI;
      this.goal.pitch = clamp(from.pitch, -STEEPEST, STEEPEST);
    }
    this.onMove();
  }

  /** Stands at a place and looks at another. */
  standAt(eye: Vector3, target: Vector3): void {
    const way = target.clone().sub(eye);
    const radius = Math.max(way.length(), NEAREST_M);
    const pitch = Math.asin(clamp(way.z / radius, -1, 1));
    this.lookAt(target, radius, { yaw: Math.atan2(way.y, way.x), pitch });
  }

  /** Is there at once. */
  settle(): void {
    this.now.target.copy(this.goal.target);
    Object.assign(this.now, { yaw: this.goal.yaw, pitch: this.goal.pitch, radius: this.goal.radius });
    this.place();
    this.onMove();
  }

  /** Goes on for so many seconds; whether it moves still. */
  update(seconds: number): boolean {
    this.drive(seconds);
    const share = 1 - LEFT_AFTER_SECOND ** seconds;
    const { now, goal } = this;
    now.target.lerp(goal.target, share);
    now.yaw += (goal.yaw - now.yaw) * share;
    now.pitch += (goal.pitch - now.pitch) * share;
    now.radius *= (goal.radius / now.radius) ** share;
    this.place();
    const off =
      now.target.distanceTo(goal.target) / goal.radius +
      Math.abs(goal.yaw - now.yaw) +
      Math.abs(goal.pitch - now.pitch) +
      Math.abs(Math.log(goal.radius / now.radius));
    return off > 1e-3 || this.held.size > 0;
  }

  private place(): void {
    const { target, radius } = this.now;
    this.camera.position.copy(target).addScaledVector(direction(this.now), -radius);
    this.camera.lookAt(target);
    this.camera.near = clamp(radius * 0.01, 0.02, 2);
    this.camera.far = Math.max(400, radius * 20);
    this.camera.updateProjectionMatrix();
  }

  private down(event: PointerEvent): void {
    this.element.focus({ preventScroll: true });
    this.element.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    if (this.pointers.size === 1) this.travelled = 0;
  }

  private move(event: PointerEvent): void {
    const last = this.pointers.get(event.pointerId);
    if (!last) return;
    const dx = event.clientX - last.x;
    const dy = event.clientY - last.y;
    const before = this.spread();
    last.x = event.clientX;
    last.y = event.clientY;
    this.travelled += Math.abs(dx) + Math.abs(dy);
    if (this.pointers.size === 2) {
      const after = this.spread();
      if (before > 0 && after > 0) this.zoom(before / after);
      // Both fingers move: each counts half.
      this.pan(dx / 2, dy / 2);
    } else if ((event.buttons & 6) !== 0 || event.shiftKey) {
      this.pan(dx, dy);
    } else {
      this.turn(dx, dy);
    }
    this.touched();
  }

  private up(event: PointerEvent): void {
    const wasAlone = this.pointers.size === 1;
    this.pointers.delete(event.pointerId);
    if (wasAlone && this.travelled < 6 && event.button === 0) this.onTap(event.clientX, event.clientY);
  }

  /** Between two fingers. */
  private spread(): number {
    const [a, b] = [...this.pointers.values()];
    return a && b ? Math.hypot(a.x - b.x, a.y - b.y) : 0;
  }

  private wheel(event: WheelEvent): void {
    event.preventDefault();
    const lines = event.deltaMode === WheelEvent.DOM_DELTA_LINE ? 24 : 1;
    const amount = clamp(event.deltaY * lines, -240, 240) * 0.0016;
    if (this.mode === 'fly') this.advance(-amount * this.goal.radius, 0, 0);
    else this.zoom(Math.exp(amount));
    this.touched();
  }

  private touched(): void {
    this.onTouched();
    this.onMove();
  }

  private zoom(factor: number): void {
    this.goal.radius = clamp(this.goal.radius * factor, NEAREST_M, FARTHEST_M);
  }

  private turn(dx: number, dy: number): void {
    const { goal } = this;
    const sign = this.mode === 'fly' ? 0.6 : 1;
    const eye = goal.target.clone().addScaledVector(direction(goal), -goal.radius);
    goal.yaw -= dx * TURN * sign;
    goal.pitch = clamp(goal.pitch - dy * TURN * sign, -STEEPEST, STEEPEST);
    // Who flies turns where they are; what they look at moves.
    if (this.mode === 'fly') goal.target.copy(eye).addScaledVector(direction(goal), goal.radius);
  }

  private pan(dx: number, dy: number): void {
    const height = Math.max(this.element.clientHeight, 1);
    const metres = (2 * this.goal.radius * Math.tan((this.camera.fov * Math.PI) / 360)) / height;
    const right = new Vector3(Math.sin(this.goal.yaw), -Math.cos(this.goal.yaw), 0);
    const up = right.clone().cross(direction(this.goal));
    this.goal.target.addScaledVector(right, -dx * metres).addScaledVector(up, dy * metres);
  }

  private advance(forward: number, right: number, up: number): void {
    const { yaw, target } = this.goal;
    target.addScaledVector(direction(this.goal), forward);
    target.addScaledVector(new Vector3(Math.sin(yaw), -Math.cos(yaw), 0), right);
    target.z += up;
  }

  private key(event: KeyboardEvent): void {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (!KEYS.has(event.code)) return;
    event.preventDefault();
    this.held.add(event.code);
    this.touched();
  }

  /** What held keys do. */
  private drive(seconds: number): void {
    if (this.held.size === 0) return;
    const axis = (more: string, less: string) =>
      Number(this.held.has(more)) - Number(this.held.has(less));
    const fast = this.held.has('ShiftLeft') || this.held.has('ShiftRight') ? 3 : 1;
    const step = clamp(this.goal.radius, 0.8, 30) * 0.9 * seconds * fast;
    this.advance(axis('KeyW', 'KeyS') * step, axis('KeyD', 'KeyA') * step, axis('KeyE', 'KeyQ') * step);
    const turn = (seconds * 1.4) / TURN;
    const [dx, dy] = [axis('ArrowRight', 'ArrowLeft') * turn, axis('ArrowDown', 'ArrowUp') * turn];
    if (dx !== 0 || dy !== 0) this.turn(this.mode === 'fly' ? dx : -dx, this.mode === 'fly' ? dy : -dy);
    const zoom = axis('Minus', 'Equal') + axis('NumpadSubtract', 'NumpadAdd');
    if (zoom !== 0) this.zoom(Math.exp(zoom * seconds * 1.5));
  }
}

const KEYS = new Set([
  ...['KeyW', 'KeyA', 'KeyS', 'KeyD', 'KeyQ', 'KeyE', 'ShiftLeft', 'ShiftRight'],
  ...['ArrowUp', 'ArrowDown', 'ArrowLeft', 'ArrowRight'],
  ...['Minus', 'Equal', 'NumpadSubtract', 'NumpadAdd'],
]);

function direction({ yaw, pitch }: Turned): Vector3 {
  return new Vector3(
    Math.cos(pitch) * Math.cos(yaw),
    Math.cos(pitch) * Math.sin(yaw),
    Math.sin(pitch),
  );
}

/** How far from its middle all of a box is seen; `wide` and `steep` are tangents of half of the view. */
export function distanceToSee(min: Vector3, max: Vector3, from: Turned, wide: number, steep: number): number {
  const forward = direction(from);
  const right = new Vector3(Math.sin(from.yaw), -Math.cos(from.yaw), 0);
  const up = right.clone().cross(forward);
  let distance = 0;
  for (let corner = 0; corner < 8; corner += 1) {
    const sign = (bit: number) => ((corner >> bit) & 1) - 0.5;
    const at = max.clone().sub(min).multiply(new Vector3(sign(0), sign(1), sign(2)));
    const aside = Math.max(Math.abs(at.dot(right)) / wide, Math.abs(at.dot(up)) / steep);
    distance = Math.max(distance, aside - at.dot(forward));
  }
  return distance;
}

export function clamp(value: number, low: number, high: number): number {
  return Math.min(high, Math.max(low, value));
}
