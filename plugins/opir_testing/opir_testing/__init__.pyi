from opir_testing.contracts.confidence_and_classifiers import (
    ClassifierContract as ClassifierContract,
    ConfidenceContract as ConfidenceContract,
)
from opir_testing.contracts.contract import (
    ConformanceError as ConformanceError,
    Contract as Contract,
    require as require,
)
from opir_testing.contracts.detection import (
    DetectionContract as DetectionContract,
)
from opir_testing.contracts.directors import (
    DirectorContract as DirectorContract,
)
from opir_testing.contracts.outputs import (
    EncoderContract as EncoderContract,
)
from opir_testing.contracts.radiometry import (
    AtmosphereContract as AtmosphereContract,
    BackgroundContract as BackgroundContract,
    SignatureContract as SignatureContract,
    SourceContract as SourceContract,
)
from opir_testing.contracts.readers import (
    ReaderContract as ReaderContract,
)
from opir_testing.contracts.renderers import (
    RendererContract as RendererContract,
)
from opir_testing.contracts.results import (
    ExecutorContract as ExecutorContract,
    ExporterContract as ExporterContract,
    MetricContract as MetricContract,
    RunViewContract as RunViewContract,
)
from opir_testing.contracts.scenes import (
    SceneContract as SceneContract,
)
from opir_testing.contracts.sensors import (
    ConstellationContract as ConstellationContract,
    SensorContract as SensorContract,
)
from opir_testing.contracts.sinks import (
    SinkContract as SinkContract,
)
from opir_testing.contracts.target_classes import (
    TargetClassContract as TargetClassContract,
)
from opir_testing.contracts.targets import (
    TargetContract as TargetContract,
)
from opir_testing.contracts.tracker_parts import (
    TrackerPartContract as TrackerPartContract,
)
from opir_testing.contracts.trackers import (
    TrackerContract as TrackerContract,
)
from opir_testing.doubles import (
    CertainDetection as CertainDetection,
    CountingTracker as CountingTracker,
    FullConfidence as FullConfidence,
    SilentTracker as SilentTracker,
    UnknownClassifier as UnknownClassifier,
    VerticalTargets as VerticalTargets,
    stub_estimates as stub_estimates,
    stub_plan as stub_plan,
    stub_regions as stub_regions,
    stub_scene as stub_scene,
    stub_sensor as stub_sensor,
    stub_window as stub_window,
)
