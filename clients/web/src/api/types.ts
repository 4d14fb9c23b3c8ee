// What the server says, as far as the page reads it. `/openapi.json` has all of it.

export type Triple = [number, number, number];
export type Quaternion = [number, number, number, number];

export interface MapSummary {
  map_id: string;
  epoch: number;
  newest_stamp_ns: number;
  bounds: { min: Triple; max: Triple } | null;
  modalities: string[];
  problem?: string;
}

export interface Pose {
  translation: Triple;
  rotation: Quaternion;
}

export interface Intrinsics {
  fx: number;
  fy: number;
  cx: number;
  cy: number;
  width: number;
  height: number;
}

export interface FrameCounts {
  received: number;
  integrated: number;
  dropped: Record<string, number>;
  rejected: Record<string, number>;
  waiting: number;
  lost: number;
}

export interface RobotReport {
  robot_id: string;
  counts: FrameCounts;
  newest_stamp_ns: number;
  sensor_id: string;
  world_from_camera: Pose;
  intrinsics: Intrinsics;
}

export interface MapStats {
  map: MapSummary;
  frames: number;
  frames_empty: number;
  steps: number;
  voxels: number;
  rows: number;
  surfels: number;
  key_frames: number;
  map_bytes: number;
  voxels_refused: number;
  losses: Record<string, number>;
  stages_ms: Record<string, number>;
  counts: FrameCounts;
  robots: RobotReport[];
  visible_after: { frames: number; sum_s: number };
  atoms: number;
  resident_bytes: number;
  server_us: number;
}

export interface Match {
  id: number;
  score: number;
  centroid_m: Triple;
  obb: { center_m: Triple; rotation: Quaternion; half_size_m: Triple };
  extent_m: Triple;
  voxels: number;
  best_view: Pose | null;
}

export interface TextAnswer {
  matches: Match[];
  places_m?: Triple[];
  place_score?: number[];
  encoder_id: string;
  epoch: number;
  server_us: number;
}

export interface Encoders {
  server: { encoder_id: string; dimension: number } | null;
  map: { encoder_id: string; dimension: number } | null;
}

export interface PointsAnswer {
  epoch: number;
  server_us: number;
  distance_m?: (number | null)[];
  gradient?: [number | null, number | null, number | null][];
  state?: number[];
}

export interface Snapshot {
  name: string;
  bytes: number;
  created_ns: number;
  epoch: number;
  frames: number;
  /** Why it cannot be read. */
  problem?: string;
}
