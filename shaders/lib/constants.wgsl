// Numbers that host and shaders share; src/backend/gpu/tests/shaders.rs compares them with the
// host's.

// Numbers of a residual and of an occupancy feature.
const SDF_FEATURES = 16u;
const OCCUPANCY_FEATURES = 8u;
// Quads (vec4) of a learned row: residual feature, occupancy feature, explicit (δd, δg).
const ROW_QUADS = 7u;
const OCCUPANCY_QUAD = 4u;
const EXPLICIT_QUAD = 6u;

// No voxel, no row, no sample kind.
const NONE = 0xffffffffu;

// Flags of a row. A step touched it; with its occupancy feature; it changed since the host read it.
const TOUCHED = 1u;
const OCCUPIED = 2u;
const CHANGED = 4u;

// Kinds of samples.
const FREE = 0u;
const PERTURBED = 1u;
const SURFACE = 2u;

// Most points of a stencil; the distance from its centre, m.
const STENCIL_POINTS = 6u;
const STENCIL_M: f32 = 0.03;
// The share of a corner's gradient that counts.
const GRADIENT_SHARE: f32 = 0.5;
// The share of a surfel's radius around its rim that counts as over the disc.
const RIM_SHARE: f32 = 0.5;
const CONTEXT_LIMIT_M: f32 = 1.0;
const SURFACE_LOGIT: f32 = 1.0986123;
const OCCUPANCY_WIDTH_M: f32 = 0.025;
const PRIOR_LIMIT: f32 = 4.0;
const CONFIDENT_LOGIT: f32 = 2.0;
const SAFE_NORM: f32 = 1e-12;

// Adam.
const BETA1: f32 = 0.9;
const BETA2: f32 = 0.999;
const LOG2_BETA1: f32 = -0.15200313166341736;
const LOG2_BETA2: f32 = -0.001443398276949825;
const EPSILON: f32 = 1e-8;

// Gradients of rows are summed in fixed point, so that the order of the sums does not show: units
// in which a sample's share counts, per column, before the factor of the batch's size.
const DISTANCE_UNITS: f32 = 256.0;
const GRADIENT_UNITS: f32 = 2048.0;
const SDF_UNITS: f32 = 2048.0;
const OCCUPANCY_UNITS: f32 = 524288.0;

// Losses, in the order in which they are summed and read back.
const LOSSES = 8u;
