from opir_core._version import (
    __version__ as __version__,
)
from opir_core.errors import (
    ModelError as ModelError,
    OpirError as OpirError,
    PluginError as PluginError,
    Problem as Problem,
    SceneError as SceneError,
    SinkError as SinkError,
)
from opir_core.host.host import (
    Host as Host,
)
from opir_core.interfaces.impact_regions import (
    ImpactRegion as ImpactRegion,
)
from opir_core.interfaces.records import (
    Detections as Detections,
    DetectionTruth as DetectionTruth,
    Tracks as Tracks,
    Window as Window,
)
from opir_core.output.saved_runs import (
    load_run as load_run,
)
from opir_core.planning.plan import (
    Plan as Plan,
    compile_plan as compile_plan,
    reseeded as reseeded,
)
from opir_core.reading import (
    example as example,
    load_scene as load_scene,
    scene_from_mapping as scene_from_mapping,
)
from opir_core.scene.scene import (
    Scene as Scene,
)
from opir_core.simulation.engine import (
    Engine as Engine,
)
from opir_core.simulation.run import (
    Run as Run,
    plan_windows as plan_windows,
    replicates as replicates,
    run_of_plan as run_of_plan,
    simulate as simulate,
    windows as windows,
)
