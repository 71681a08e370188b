"""Results of the commands, with the names of their JSON.

`docs/reference/report.md` explains those of `Report`, `docs/reference/comparison.md` those of `Comparison`. Sizes are
in bytes, times in seconds, lengths in the mesh's unit, shares between 0 and 1. `peak_resident` is None in results of
calls: the system measures the memory of a process, not that of a call.
"""

from dataclasses import dataclass, field
from typing import Any, Literal

from drystone.record import Record

Point = tuple[float, float, float]


@dataclass(frozen=True)
class Options(Record):
    """The options of a run, as the command line names them; None where not given."""

    ratio: float | None
    faces: int | None
    max_error: float | None
    borders: str
    weld: str
    pieces: str
    topology: str
    doubles: str
    normals: str
    up: str
    seams: str | None
    textures: str
    textures_outside: str
    texels: float
    atlas: int
    image: str
    uv_weight: float
    memory: int | None
    threads: int | None
    work: str | None
    resume: str
    keep_work: bool
    no_sync: bool
    force: bool
    task_runner: str | None
    tasks: int
    task_tries: int
    cluster_faces: int
    passes: int
    metric: str | None
    metric_option: tuple[str, ...]
    remesh: dict[str, Any] | None = field(hash=False)
    optimize: bool
    one_by_one: bool
    exclude: tuple[str, ...]
    measure: bool
    samples: int | None
    seed: int | None


@dataclass(frozen=True)
class Faces(Record):
    """Numbers of triangles."""

    input: int
    target: int
    output: int


@dataclass(frozen=True)
class Measured(Record):
    """Root mean square of the distances between result and input, at `points` sample points."""

    rms: float
    to_input: float
    to_result: float
    points: int


@dataclass(frozen=True)
class ErrorFigures(Record):
    """The highest cost of a collapse in the last pass, and the measured deviation."""

    threshold: float
    measured: Measured | None


@dataclass(frozen=True)
class TopologyChanges(Record):
    """What changed of the topology."""

    holes_closed: int
    handles_cut: int
    pieces_dropped: int
    pieces_area: float
    vertices_welded: int
    complex_resolved: int
    faces_forced: int


@dataclass(frozen=True)
class Seconds(Record):
    """Times of the phases."""

    total: float
    scan: float
    partition: float
    remesh: float
    simplify: float
    stitch: float
    bake: float
    write: float
    measure: float
    draw: float


@dataclass(frozen=True)
class Memory(Record):
    """Memory in bytes: allowed, predicted, and the peak that the system measured.

    The peak of a process holds all that the process does: it is None in reports of calls, and known in those that the
    command line writes.
    """

    budget: int
    predicted_peak: int
    peak_resident: int | None


@dataclass(frozen=True)
class Bytes(Record):
    """Bytes that the process read and wrote during the call."""

    input: int
    read: int
    written: int
    output: int
    scratch_peak: int


@dataclass(frozen=True)
class Files(Record):
    """Materials and textures, of the input and left in the result."""

    materials: int
    materials_left: int
    textures: int
    textures_left: int
    images: int
    image_bytes: int
    megapixels: tuple[float, ...] | None


@dataclass(frozen=True)
class Bake(Record):
    """New textures."""

    images: int
    texels: int
    fill: float
    colourless: int
    charts: int
    texel: float


@dataclass(frozen=True)
class Phase(Record):
    """A phase, in seconds from the start."""

    name: str
    begin: float
    end: float


@dataclass(frozen=True)
class Sample(Record):
    """Memory, and bytes read and written, at a time."""

    seconds: float
    resident: int
    read: int
    written: int


@dataclass(frozen=True)
class Timeline(Record):
    """The run over time."""

    phases: tuple[Phase, ...]
    samples: tuple[Sample, ...]


@dataclass(frozen=True)
class RemeshPass(Record):
    """A pass that remeshed."""

    clusters: int
    faces_in: int
    faces_out: int
    wanted: int
    cell_mass: float
    threshold: float | None
    cells: int
    held: int
    added: int
    junctions: int
    kept: int
    passed_through: int


@dataclass(frozen=True)
class Stage(Record):
    """End of a stage of a pass."""

    faces: int
    threshold: float
    rms_estimate: float


@dataclass(frozen=True)
class Pass(Record):
    """A pass that collapsed edges."""

    clusters: int
    faces_in: int
    faces_out: int
    threshold: float
    border_vertices: int
    seam_vertices: int
    stages: tuple[Stage, ...]


@dataclass(frozen=True)
class Floor(Record):
    """What holds the mesh above its target."""

    border: int
    seam: int
    topology: int
    pieces: int
    non_manifold: int
    doubles: int


@dataclass(frozen=True)
class FarPlace(Record):
    """A point, and the closest one of the other mesh."""

    distance: float
    position: Point
    closest: Point


@dataclass(frozen=True)
class Histogram(Record):
    """Shares of the surface by distance."""

    edges: tuple[float, ...]
    shares: tuple[float, ...]


@dataclass(frozen=True)
class Distances(Record):
    """Distances from one surface to the other."""

    max: float
    mean: float
    rms: float
    median: float
    p95: float
    p99: float
    worst: tuple[FarPlace, ...]
    histogram: Histogram
    cut_searches: int
    max_bound: float


@dataclass(frozen=True)
class NormalAngles(Record):
    """Angles between the normals of both surfaces, in degrees."""

    mean: float
    p95: float
    flipped: float


@dataclass(frozen=True)
class Lengths(Record):
    """Largest and root-mean-square distance of borders."""

    max: float
    rms: float


@dataclass(frozen=True)
class Areas(Record):
    """Areas of the original and of the result."""

    before: float
    after: float


@dataclass(frozen=True)
class Volumes(Record):
    """Volumes of the original and of the result; None for a mesh with open edges."""

    before: float | None
    after: float | None


@dataclass(frozen=True)
class Geometry(Record):
    """Distances, angles, areas and volumes."""

    diagonal: float
    forward: Distances
    backward: Distances
    symmetric: Distances
    normals: NormalAngles
    area: Areas
    area_ratio: float
    volume: Volumes
    volume_ratio: float | None
    border: Lengths | None


@dataclass(frozen=True)
class SeamFigures(Record):
    """What meets along the seams of a mesh."""

    length: float
    colour_mean: float
    colour_rms: float
    gap_median: float | None
    gap_p95: float | None
    gap_texels_median: float | None
    gap_texels_p95: float | None
    outside_fraction: float | None


@dataclass(frozen=True)
class Seams(Record):
    """Seams of the original and of the result."""

    before: SeamFigures
    after: SeamFigures


@dataclass(frozen=True)
class TextureFigures(Record):
    """Colours and texture drift; colours from 0 to 255."""

    colour_mean: float
    colour_rms: float
    colour_backward_mean: float
    colour_backward_rms: float
    slide_mean: float | None
    slide_median: float | None
    slide_p95: float | None
    slide_texels_median: float | None
    slide_texels_p95: float | None
    repeated_fraction: float
    outside_fraction: float | None
    untextured_fraction: float
    folded_triangles: int
    folded_triangles_before: int
    seams: Seams
    images: int
    reduced_images: int


@dataclass(frozen=True)
class View(Record):
    """A view, in degrees, and the pinholes in it."""

    turn: float
    tilt: float
    ppm: float
    behind_ppm: float


@dataclass(frozen=True)
class Pinholes(Record):
    """Pixels per million through which the background shows."""

    ppm: float
    behind_ppm: float
    pixels: int
    worst: View


@dataclass(frozen=True)
class Topology(Record):
    """Counts of a mesh, welded by position."""

    vertices: int
    seam_vertices: int
    edges: int
    faces: int
    boundary_edges: int
    boundary_loops: int
    non_manifold_edges: int
    inconsistent_edges: int
    folded_edges: int
    components: int
    euler: int
    seam_edges: int
    charts: int
    degenerate_faces: int


@dataclass(frozen=True)
class Topologies(Record):
    """Counts of the original and of the result."""

    before: Topology
    after: Topology


@dataclass(frozen=True)
class Quality(Record):
    """Shapes of triangles and numbers of edges at vertices."""

    regularity_mean: float
    sliver_share: float
    valence_mean: float
    valence_max: int
    valence_regular_share: float


@dataclass(frozen=True)
class Qualities(Record):
    """Shapes in the original and in the result."""

    before: Quality
    after: Quality


@dataclass(frozen=True)
class Comparison(Record):
    """What `drystone.compare` measured."""

    version: int
    original: str
    result: str
    samples: int | None
    seed: int
    texel: float | None
    geometry: Geometry
    texture: TextureFigures | None
    pinholes: Pinholes | None
    topology: Topologies
    quality: Qualities
    seconds: float
    peak_resident: int | None
    warnings: tuple[str, ...]


@dataclass(frozen=True)
class Report(Record):
    """What `drystone.simplify` did."""

    program: str
    command: str | None
    began: int
    status: Literal["done", "target-missed"]
    resumed: bool
    input: str
    inputs: tuple[str, ...]
    input_files: int
    options: Options
    threads: int
    output: str
    faces: Faces
    error: ErrorFigures
    topology: TopologyChanges
    new_texture_below: float | None
    seam_density: float | None
    seconds: Seconds
    memory: Memory
    io: Bytes
    files: Files
    bake: Bake | None
    timeline: Timeline
    remesh: tuple[RemeshPass, ...]
    passes: tuple[Pass, ...]
    floor: Floor | None
    comparison: Comparison | None
    repairs: dict[str, int] = field(hash=False)
    warnings: tuple[str, ...]


@dataclass(frozen=True)
class InputCounts(Record):
    """Counts of the input of a plan."""

    files: int
    bytes: int
    vertices: int
    texcoords: int
    polygons: int
    triangles: int


@dataclass(frozen=True)
class PlannedPass(Record):
    """A pass as planned."""

    clusters: int
    faces_in: int
    faces_out: int
    is_trim: bool
    is_remesh: bool


@dataclass(frozen=True)
class PlannedBake(Record):
    """New textures as planned."""

    images: int
    texels: int
    bytes: int
    input_images: int
    input_pixels: int
    reduced_images: int


@dataclass(frozen=True)
class PlannedMemory(Record):
    """Memory of each phase in bytes, as predicted."""

    scan: int
    partition: int
    simplify: int
    bake: int | None
    write: int
    peak: int


@dataclass(frozen=True)
class Scratch(Record):
    """Bytes that the intermediate files take, and bytes that are free where they go."""

    bytes: int
    free: int | None
    folder: str


@dataclass(frozen=True)
class PlannedSeconds(Record):
    """Times of the phases, as predicted."""

    total: float
    scan: float
    partition: float
    simplify: float
    bake: float
    write: float


@dataclass(frozen=True)
class PlannedMachines(Record):
    """What several machines would bring, in seconds; the bandwidth in bytes a second."""

    machines: int
    bandwidth: int | None
    seconds: float
    seconds_of_one: float
    seconds_with_own_disk: float


@dataclass(frozen=True)
class Plan(Record):
    """What `drystone.plan` predicts of a simplification."""

    input: InputCounts
    target: int | None
    threads: int
    cluster_faces: int
    passes: tuple[PlannedPass, ...]
    budget: int
    bake: PlannedBake | None
    memory: PlannedMemory
    scratch: Scratch
    output_bytes: int
    seconds: PlannedSeconds
    machines: PlannedMachines | None
    warnings: tuple[str, ...]


@dataclass(frozen=True)
class PlannedLevel(Record):
    """A level of tiles as planned."""

    level: int
    tiles: int
    triangles: int
    texels: int
    bytes: int


@dataclass(frozen=True)
class TilePlan(Record):
    """What `drystone.plan` predicts of a pyramid of tiles."""

    input: InputCounts
    levels: tuple[PlannedLevel, ...]
    threads: int
    budget: int
    memory: int
    scratch: Scratch
    output_bytes: int
    seconds: float
    machines: PlannedMachines | None
    warnings: tuple[str, ...]


@dataclass(frozen=True)
class Inspection(Record):
    """What `drystone.inspect` counted."""

    files: int
    bytes: int
    vertices: int
    texcoords: int
    polygons: int
    larger_polygons: int
    triangles: int
    has_normals: bool
    has_colours: bool
    bounds: tuple[Point, ...]
    size: Point
    decimals: tuple[int, ...]
    parts: int
    materials: int
    undefined_materials: int
    textures: int
    missing_textures: int
    outside_textures: int
    welded_vertices: int
    unused_vertices: int
    topology: Topology
    faults: dict[str, int] = field(hash=False)
    warnings: tuple[str, ...]


@dataclass(frozen=True)
class Counts(Record):
    """Counts of a mesh, held in memory."""

    boundary_edges: int
    boundary_loops: int
    charts: int
    components: int
    degenerate_faces: int
    duplicate_faces: int
    euler: int
    faces: int
    folded_edges: int
    folded_uv: int
    inconsistent_edges: int
    non_manifold_edges: int
    non_manifold_vertices: int
    seam_edges: int
    single_faces: int
    t_junctions: int
    unused_vertices: int
    uv_degenerate: int
    uv_negative: int
    uv_positive: int
    vertices: int
    zero_area_faces: int


@dataclass(frozen=True)
class Check(Record):
    """What `drystone.check` found in a mesh; `new` has the faults that `before` does not have, in words."""

    after: Counts
    before: Counts | None
    new: tuple[str, ...]


@dataclass(frozen=True)
class LevelCheck(Record):
    """What is in a level of tiles."""

    step: float
    tiles: int
    triangles: int
    triangles_max: int
    image_bytes: int
    border_edges: int
    unequal_edges: int
    longest_skirt: float
    duplicate_triangles: int


@dataclass(frozen=True)
class TilesetCheck(Record):
    """What `drystone.check` found in a folder of tiles."""

    tiles: int
    contents: int
    bytes: int
    levels: tuple[LevelCheck, ...]
    measured: int
    error_factor: float | None
    fault_count: int
    faults: tuple[str, ...]


@dataclass(frozen=True)
class Place(Record):
    """A place on earth: degrees, and metres above the ellipsoid."""

    longitude: float
    latitude: float
    height: float


@dataclass(frozen=True)
class Level(Record):
    """A level of tiles."""

    level: int
    tiles: int
    mesh_faces: int
    faces: int
    faces_max: int
    oversized: int
    texels: int
    texels_max: int
    fill: float
    colourless: int
    charts: int
    reduced: int
    colour_rms: float | None
    texel: float
    to_input_p99: float
    from_input_p99: float
    geometric_error: float
    bytes: int


@dataclass(frozen=True)
class TileReport(Record):
    """What `drystone.tile` made."""

    triangles: int
    origin: Place | None
    levels: tuple[Level, ...]
    seconds: float
    peak_resident: int | None
    warnings: tuple[str, ...]


@dataclass(frozen=True)
class PassStatus(Record):
    """The current pass of a job."""

    number: int
    clusters: int
    clusters_done: int
    triangles_done: int


@dataclass(frozen=True)
class BakeStatus(Record):
    """New textures of a job."""

    images_decoded: int
    patches: int | None
    patches_done: int


@dataclass(frozen=True)
class StageStatus(Record):
    """How far the tasks are that other processes do."""

    kind: str
    tasks: int
    tasks_done: int
    tasks_failed: int
    last_failure: str | None


@dataclass(frozen=True)
class LevelStatus(Record):
    """The level of a pyramid that tiles are made of."""

    number: int
    tiles: int
    tiles_done: int


@dataclass(frozen=True)
class Status(Record):
    """What an unfinished job has done, or a finished one whose work folder was kept."""

    running: bool
    seconds: int
    seconds_of_process: int
    processes: int
    input: str | None
    input_files: int
    input_bytes: int
    triangles: int | None
    passes: int
    passes_done: int
    triangles_left: int | None
    pass_: PassStatus | None
    stage: StageStatus | None
    bake: BakeStatus | None
    level: LevelStatus | None
    written: bool
    last_error: str | None
    last_error_of_process: int | None
    bytes: int


@dataclass(frozen=True)
class Finished(Record):
    """A finished job whose work folder was removed."""

    running: bool
    written: bool
    output: str
