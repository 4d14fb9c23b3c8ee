//! The sections of a map file.

use crate::storage::sections::Tag;

pub(super) const KIND: Tag = Tag(*b"KIND");
pub(super) const CONFIG: Tag = Tag(*b"CONF");
pub(super) const PROGRESS: Tag = Tag(*b"PROG");
pub(super) const TREE: Tag = Tag(*b"TREE");
pub(super) const NODE_CHILDREN: Tag = Tag(*b"NCHI");
pub(super) const NODE_CORNERS: Tag = Tag(*b"NCOR");
pub(super) const NODE_LOWS: Tag = Tag(*b"NLOW");
pub(super) const NODE_SIZES: Tag = Tag(*b"NSIZ");
pub(super) const NODE_BRICKS: Tag = Tag(*b"NBRK");
pub(super) const VERTICES: Tag = Tag(*b"VERT");
/// Of files from before it was known who saw what; they have none of those that follow.
pub(super) const FIRST_SURFELS: Tag = Tag(*b"SURF");
pub(super) const SURFELS: Tag = Tag(*b"SRF2");
pub(super) const SURFEL_WITNESSES: Tag = Tag(*b"SWIT");
pub(super) const WITNESSES: Tag = Tag(*b"EWIT");
pub(super) const CELL_SEEN_BY: Tag = Tag(*b"ESBY");
pub(super) const PRIOR_FREE_BY: Tag = Tag(*b"PFBY");
pub(super) const KEY_ROBOTS: Tag = Tag(*b"KROB");
pub(super) const TIMELINE: Tag = Tag(*b"TIME");
pub(super) const SURFEL_LINKS: Tag = Tag(*b"SLNK");
pub(super) const SURFEL_FREE: Tag = Tag(*b"SFRE");
pub(super) const BRICKS: Tag = Tag(*b"EBRK");
pub(super) const BRICK_KNOWN: Tag = Tag(*b"EKNO");
pub(super) const CELL_ODDS: Tag = Tag(*b"EODD");
pub(super) const CELL_CROSSED: Tag = Tag(*b"ECRO");
pub(super) const CELL_HIT: Tag = Tag(*b"EHIT");
pub(super) const CELL_SURFELS: Tag = Tag(*b"ESUR");
pub(super) const PRIOR_NEAREST: Tag = Tag(*b"PNEA");
pub(super) const PRIOR_REACH: Tag = Tag(*b"PREA");
pub(super) const PRIOR_VALUES: Tag = Tag(*b"PVAL");
pub(super) const PRIOR_SEEN: Tag = Tag(*b"PSEE");
pub(super) const PRIOR_NEXT: Tag = Tag(*b"PNXT");
pub(super) const PRIOR_PREVIOUS: Tag = Tag(*b"PPRV");
pub(super) const PRIOR_HEADS: Tag = Tag(*b"PHEA");
pub(super) const RINGED: Tag = Tag(*b"RING");
/// Passed over by who only wants distances, and absent in files from before there were several.
pub(super) const ROBOTS: Tag = Tag(*b"robo");
/// Absent where there is no journal; says nothing to who only answers.
pub(super) const MARK: Tag = Tag(*b"jour");
pub(super) const KEY_FRAMES: Tag = Tag(*b"KREC");
pub(super) const KEY_PIXELS: Tag = Tag(*b"KPIX");
pub(super) const KEY_CELLS: Tag = Tag(*b"KCEL");
pub(super) const KEY_BLOCKS: Tag = Tag(*b"KBLK");
pub(super) const KEY_TRAINED: Tag = Tag(*b"KTRA");
pub(super) const KEY_COUNTS: Tag = Tag(*b"KCNT");
pub(super) const KEY_IDS: Tag = Tag(*b"KIDS");
pub(super) const ROWS: Tag = Tag(*b"BROW");
pub(super) const ROW_MOMENTS: Tag = Tag(*b"BMOM");
pub(super) const ROW_STEPS: Tag = Tag(*b"BSTP");
pub(super) const DECODERS: Tag = Tag(*b"BDEC");
pub(super) const RADIANCE: Tag = Tag(*b"RCON");
pub(super) const COLOR_CELLS: Tag = Tag(*b"CCEL");
pub(super) const COLOR_SEEN: Tag = Tag(*b"CSEE");
pub(super) const COLOR_LEARNED: Tag = Tag(*b"CLRN");
pub(super) const COLOR_MOMENTS: Tag = Tag(*b"CMOM");
pub(super) const COLOR_STEPS: Tag = Tag(*b"CSTP");
pub(super) const KEY_COLORS: Tag = Tag(*b"KCOL");
pub(super) const KEY_GAINS: Tag = Tag(*b"KGAI");
/// Absent in files from before surfaces had a relief.
pub(super) const RELIEF: Tag = Tag(*b"crel");
/// Of files from before that; colours alone.
pub(super) const VIEW_COLORS: Tag = Tag(*b"VTEX");
pub(super) const VIEW_TEXELS: Tag = Tag(*b"vtex");
/// Absent where colours are the same from all sides, and in files from before they could be others.
pub(super) const COLOR_DEGREE: Tag = Tag(*b"cdeg");
pub(super) const COLOR_HARMONICS: Tag = Tag(*b"char");
pub(super) const VIEW_HARMONICS: Tag = Tag(*b"vhar");
pub(super) const LANGUAGE: Tag = Tag(*b"LCON");
pub(super) const DICTIONARY: Tag = Tag(*b"LDIC");
pub(super) const ATOMS: Tag = Tag(*b"LATM");
pub(super) const SCATTER: Tag = Tag(*b"LSCA");
pub(super) const CODE_CELLS: Tag = Tag(*b"LCEL");
pub(super) const CODE_WEIGHTS: Tag = Tag(*b"LWGT");
pub(super) const CODES: Tag = Tag(*b"LCOD");
pub(super) const VIEW_HALVES: Tag = Tag(*b"LHAL");
pub(super) const VIEW_FLOATS: Tag = Tag(*b"LFLO");
pub(super) const VIEW_ATOMS: Tag = Tag(*b"LTRM");
/// Absent in files from before things were looked for.
pub(super) const VIEWPOINTS: Tag = Tag(*b"vpts");
pub(super) const VIEW: Tag = Tag(*b"VIEW");
pub(super) const VIEW_ROWS: Tag = Tag(*b"VROW");

pub(super) const ALL: [Tag; 74] = [
    KIND,
    CONFIG,
    PROGRESS,
    TREE,
    NODE_CHILDREN,
    NODE_CORNERS,
    NODE_LOWS,
    NODE_SIZES,
    NODE_BRICKS,
    VERTICES,
    FIRST_SURFELS,
    SURFELS,
    SURFEL_WITNESSES,
    WITNESSES,
    CELL_SEEN_BY,
    PRIOR_FREE_BY,
    KEY_ROBOTS,
    TIMELINE,
    SURFEL_LINKS,
    SURFEL_FREE,
    BRICKS,
    BRICK_KNOWN,
    CELL_ODDS,
    CELL_CROSSED,
    CELL_HIT,
    CELL_SURFELS,
    PRIOR_NEAREST,
    PRIOR_REACH,
    PRIOR_VALUES,
    PRIOR_SEEN,
    PRIOR_NEXT,
    PRIOR_PREVIOUS,
    PRIOR_HEADS,
    RINGED,
    ROBOTS,
    MARK,
    KEY_FRAMES,
    KEY_PIXELS,
    KEY_CELLS,
    KEY_BLOCKS,
    KEY_TRAINED,
    KEY_COUNTS,
    KEY_IDS,
    ROWS,
    ROW_MOMENTS,
    ROW_STEPS,
    DECODERS,
    RADIANCE,
    COLOR_CELLS,
    COLOR_SEEN,
    COLOR_LEARNED,
    COLOR_MOMENTS,
    COLOR_STEPS,
    KEY_COLORS,
    KEY_GAINS,
    RELIEF,
    VIEW_COLORS,
    VIEW_TEXELS,
    COLOR_DEGREE,
    COLOR_HARMONICS,
    VIEW_HARMONICS,
    LANGUAGE,
    DICTIONARY,
    ATOMS,
    SCATTER,
    CODE_CELLS,
    CODE_WEIGHTS,
    CODES,
    VIEW_HALVES,
    VIEW_FLOATS,
    VIEW_ATOMS,
    VIEWPOINTS,
    VIEW,
    VIEW_ROWS,
];
