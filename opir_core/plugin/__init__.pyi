from opir_core.doors import deferred as deferred
from opir_core.host.components import (
    AtmosphereModel as AtmosphereModel,
    BackgroundModel as BackgroundModel,
    ClassifierModel as ClassifierModel,
    Component as Component,
    ConfidenceModel as ConfidenceModel,
    Constellation as Constellation,
    DetectionModel as DetectionModel,
    DirectorModel as DirectorModel,
    EventEncoder as EventEncoder,
    ExecutorModel as ExecutorModel,
    ExporterModel as ExporterModel,
    FileReader as FileReader,
    MetricModel as MetricModel,
    NoConfig as NoConfig,
    RendererModel as RendererModel,
    RunView as RunView,
    SensorModel as SensorModel,
    SignatureModel as SignatureModel,
    SinkModel as SinkModel,
    SourceModel as SourceModel,
    TargetModel as TargetModel,
    TrackerModel as TrackerModel,
    TrackerPart as TrackerPart,
)
from opir_core.host.hookspecs import (
    hookimpl as hookimpl,
)
from opir_core.host.host import (
    Host as Host,
)
from opir_core.interfaces.classification import Classifier as Classifier, Confidence as Confidence
from opir_core.interfaces.contexts import (
    EncoderContext as EncoderContext,
    ModelContext as ModelContext,
    Renderer as Renderer,
    RendererContext as RendererContext,
    SensorContext as SensorContext,
    SinkContext as SinkContext,
    TargetContext as TargetContext,
    TrackerContext as TrackerContext,
)
from opir_core.interfaces.detection_models import (
    DetectionProbability as DetectionProbability,
    Measured as Measured,
    RandomDraws as RandomDraws,
    Response as Response,
)
from opir_core.interfaces.directors import (
    Command as Command,
    Director as Director,
    DirectorContext as DirectorContext,
    Situation as Situation,
)
from opir_core.interfaces.file_contents import (
    FILE_CONTENTS as FILE_CONTENTS,
    BadFileError as BadFileError,
    ReaderContext as ReaderContext,
    StateTable as StateTable,
)
from opir_core.interfaces.focal_plane import (
    FocalPlaneConfig as FocalPlaneConfig,
)
from opir_core.interfaces.impact_regions import (
    ImpactRegion as ImpactRegion,
)
from opir_core.interfaces.outputs import (
    Delivery as Delivery,
    Encoder as Encoder,
    PartlySentError as PartlySentError,
    Sink as Sink,
    Transport as Transport,
)
from opir_core.interfaces.radiometric_models import (
    AtmosphereContext as AtmosphereContext,
    Background as Background,
    BackgroundContext as BackgroundContext,
    Paths as Paths,
    SignatureContext as SignatureContext,
    Signatures as Signatures,
    SourceContext as SourceContext,
    Sources as Sources,
    Transmittance as Transmittance,
    Views as Views,
)
from opir_core.interfaces.records import (
    Batch as Batch,
    ClassifierInputs as ClassifierInputs,
    CommandRecord as CommandRecord,
    Detections as Detections,
    Exposures as Exposures,
    Tracks as Tracks,
    Window as Window,
)
from opir_core.interfaces.results import (
    Executor as Executor,
    ExecutorContext as ExecutorContext,
    Exporter as Exporter,
    ExporterContext as ExporterContext,
    Metric as Metric,
    MetricContext as MetricContext,
)
from opir_core.interfaces.sensor_health import (
    SensorHealth as SensorHealth,
)
from opir_core.interfaces.sensors import (
    Band as Band,
    Orbit as Orbit,
    Pointing as Pointing,
    ReportingStage as ReportingStage,
    ScanPattern as ScanPattern,
    Sensor as Sensor,
)
from opir_core.interfaces.trackers import (
    AssumedRate as AssumedRate,
    Tracker as Tracker,
)
from opir_core.interfaces.trajectories import Trajectories as Trajectories
from opir_core.scene.fields import (
    FieldInfo as FieldInfo,
    cited as cited,
    flag as flag,
    named as named,
    nested as nested,
    number as number,
    part as part,
    text as text,
    with_defaults as with_defaults,
)
from opir_core.scene.hypotheses import (
    GROUPS as GROUPS,
    LAUNCH_GROUPS as LAUNCH_GROUPS,
    Hypothesis as Hypothesis,
)
from opir_core.scene.scene import (
    EMITTER_TYPES as EMITTER_TYPES,
    REPORTED_TYPES as REPORTED_TYPES,
    TARGET_TYPES as TARGET_TYPES,
)
from opir_core.scene.target_classes import (
    Ballistic as Ballistic,
    BoostProfile as BoostProfile,
    EquilibriumGlide as EquilibriumGlide,
    OrbitInsertion as OrbitInsertion,
    Plume as Plume,
    TargetClass as TargetClass,
)
from opir_core.sensors.pointed_sensor import (
    ModeConfig as ModeConfig,
    PointedSensorConfig as PointedSensorConfig,
    PointingConfig as PointingConfig,
    SteeredSensorConfig as SteeredSensorConfig,
)
from opir_core.sensors.reporting import (
    ReportingConfig as ReportingConfig,
    ReportingStageConfig as ReportingStageConfig,
)
from opir_core.sensors.scanning_sensor import (
    ScanningSensorConfig as ScanningSensorConfig,
)
from opir_core.sensors.sensor_components import (
    geostationary_fleet as geostationary_fleet,
    scanning_model as scanning_model,
    scanning_sensor as scanning_sensor,
)
