// Robots: where their cameras stand, what they see, and the way that they came.

import { Color, Group, Matrix4, Quaternion, Vector3 } from 'three';
import { Line2 } from 'three/addons/lines/Line2.js';
import { LineGeometry } from 'three/addons/lines/LineGeometry.js';
import { LineMaterial } from 'three/addons/lines/LineMaterial.js';
import { LineSegments2 } from 'three/addons/lines/LineSegments2.js';
import { LineSegmentsGeometry } from 'three/addons/lines/LineSegmentsGeometry.js';

import type { Intrinsics, RobotReport } from '../api/types';

/** How far a frustum is drawn, m. */
const DEPTH_M = 0.45;
const STEP_M = 0.02;
const MAX_STEPS = 2_000;

export const ROBOT_COLORS = ['#35d0b0', '#ffb454', '#7aa8ff', '#ff7aa2', '#b48cff', '#9ad14b'];

export function robotColor(index: number): string {
  return ROBOT_COLORS[index % ROBOT_COLORS.length] ?? '#35d0b0';
}

interface Robot {
  frustum: LineSegments2;
  trail: Line2;
  steps: number[];
  shape: string;
  place: Vector3;
  dirty: boolean;
}

export class Robots {
  readonly group = new Group();
  private readonly robots = new Map<string, Robot>();
  private readonly materials: LineMaterial[] = [];

  /** Brings all of them up to date; whether anything moved. */
  update(reports: RobotReport[]): boolean {
    let moved = false;
    reports.forEach((report, index) => {
      const robot = this.robots.get(report.robot_id) ?? this.add(report.robot_id, index);
      moved = this.stand(robot, report) || moved;
    });
    for (const id of [...this.robots.keys()]) {
      if (!reports.some((report) => report.robot_id === id)) {
        this.remove(id);
        moved = true;
      }
    }
    return moved;
  }

  clear(): void {
    for (const id of [...this.robots.keys()]) this.remove(id);
  }

  places(): { id: string; place: Vector3 }[] {
    return [...this.robots].map(([id, robot]) => ({ id, place: robot.place }));
  }

  setSize(width: number, height: number): void {
    for (const material of this.materials) material.resolution.set(width, height);
  }

  private add(id: string, index: number): Robot {
    const color = new Color(robotColor(index));
    const [bold, thin] = [this.material(color, 2.6), this.material(color, 1.8)];
    thin.transparent = true;
    thin.opacity = 0.75;
    const robot: Robot = {
      frustum: new LineSegments2(new LineSegmentsGeometry(), bold),
      trail: new Line2(new LineGeometry(), thin),
      steps: [],
      shape: '',
      place: new Vector3(),
      dirty: false,
    };
    robot.trail.visible = false;
    robot.trail.frustumCulled = false;
    this.group.add(robot.frustum, robot.trail);
    this.robots.set(id, robot);
    return robot;
  }

  private material(color: Color, width: number): LineMaterial {
    const material = new LineMaterial({ linewidth: width });
    material.color.copy(color);
    this.materials.push(material);
    return material;
  }

  private remove(id: string): void {
    const robot = this.robots.get(id);
    if (!robot) return;
    for (const line of [robot.frustum, robot.trail]) {
      this.group.remove(line);
      line.geometry.dispose();
      line.material.dispose();
      this.materials.splice(this.materials.indexOf(line.material), 1);
    }
    this.robots.delete(id);
  }

  private stand(robot: Robot, { world_from_camera: pose, intrinsics }: RobotReport): boolean {
    const shape = JSON.stringify(intrinsics);
    if (shape !== robot.shape) {
      robot.shape = shape;
      robot.frustum.geometry.setPositions(frustum(intrinsics));
    }
    const place = new Vector3(...pose.translation);
    const rotation = new Quaternion(...pose.rotation);
    const matrix = new Matrix4().compose(place, rotation, new Vector3(1, 1, 1));
    const moved = !matrix.equals(robot.frustum.matrix);
    robot.frustum.matrixAutoUpdate = false;
    robot.frustum.matrix.copy(matrix);
    robot.frustum.matrixWorldNeedsUpdate = true;
    this.trace(robot, place);
    robot.place.copy(place);
    return moved;
  }

  private trace(robot: Robot, place: Vector3): void {
    const { steps } = robot;
    const isFar = steps.length === 0 || robot.place.distanceTo(place) > STEP_M;
    if (!isFar) return;
    steps.push(place.x, place.y, place.z);
    // The oldest give way, many at once: the line is made anew each time.
    if (steps.length > 3 * MAX_STEPS) steps.splice(0, 3 * (MAX_STEPS / 4));
    if (steps.length < 6) return;
    robot.trail.geometry.dispose();
    robot.trail.geometry = new LineGeometry().setPositions(steps);
    robot.trail.visible = true;
  }
}

/** Lines of a camera in its own axes: x right, y down, z forward. */
function frustum({ fx, fy, cx, cy, width, height }: Intrinsics): number[] {
  const corner = (u: number, v: number) =>
    [((u - cx) / fx) * DEPTH_M, ((v - cy) / fy) * DEPTH_M, DEPTH_M] as const;
  const corners = [corner(0, 0), corner(width, 0), corner(width, height), corner(0, height)];
  const lines: number[] = [];
  corners.forEach((from, i) => {
    const to = corners[(i + 1) % 4] ?? from;
    lines.push(0, 0, 0, ...from, ...from, ...to);
  });
  // Which way is up.
  const [left, right] = [corner(width * 0.3, 0), corner(width * 0.7, 0)];
  const tip = corner(width * 0.5, -height * 0.22);
  lines.push(...left, ...tip, ...tip, ...right);
  return lines;
}
