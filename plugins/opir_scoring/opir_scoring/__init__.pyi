from opir_scoring.arguments import (
    add_score_settings as add_score_settings,
)
from opir_scoring.command import (
    score_settings as score_settings,
)
from opir_scoring.containments import (
    Consistency as Consistency,
    consistency as consistency,
    containment as containment,
    nees as nees,
)
from opir_scoring.errors import (
    StateErrors as StateErrors,
    ground_error as ground_error,
    last_rows as last_rows,
    place_of as place_of,
    point_errors as point_errors,
    state_errors as state_errors,
)
from opir_scoring.evidence import (
    Ownership as Ownership,
    RunEvidence as RunEvidence,
    evidence_of_files as evidence_of_files,
    evidence_of_run as evidence_of_run,
    ownership as ownership,
    rows_in_force as rows_in_force,
    true_states_ecef as true_states_ecef,
)
from opir_scoring.figure_text import (
    percent_text as percent_text,
    share_text as share_text,
)
from opir_scoring.gospa_metric import (
    Gospa as Gospa,
    gospa as gospa,
)
from opir_scoring.impacts import (
    OLDEST_S as OLDEST_S,
    PHASES as PHASES,
    ImpactScores as ImpactScores,
    impact_scores as impact_scores,
    main_regions as main_regions,
    phase_scores as phase_scores,
    regions_given as regions_given,
)
from opir_scoring.launch_recognition import (
    RECOGNITION_PROBABILITY as RECOGNITION_PROBABILITY,
    recognition as recognition,
)
from opir_scoring.launch_shares import (
    NOT_SHOWN as NOT_SHOWN,
    TAILS_95 as TAILS_95,
    LaunchShare as LaunchShare,
    Tails as Tails,
    share_curve as share_curve,
    verdict_in_all as verdict_in_all,
)
from opir_scoring.launch_warnings import (
    WarningRequirement as WarningRequirement,
    WarningTimes as WarningTimes,
    warning_times as warning_times,
)
from opir_scoring.paired import (
    paired_figures as paired_figures,
)
from opir_scoring.paired_tables import (
    comparison_text as comparison_text,
)
from opir_scoring.proper_scores import (
    brier_scores as brier_scores,
    energy_scores as energy_scores,
    log_scores as log_scores,
    open_set_rate as open_set_rate,
    reliability as reliability,
)
from opir_scoring.quantiles import (
    chi_square_quantiles as chi_square_quantiles,
)
from opir_scoring.region_points import (
    region_energy_m as region_energy_m,
)
from opir_scoring.scorecard_tables import (
    scorecard_text as scorecard_text,
)
from opir_scoring.scorecards import (
    GEOMETRIES as GEOMETRIES,
    USUAL_SETTINGS as USUAL_SETTINGS,
    Scorecard as Scorecard,
    ScoredRun as ScoredRun,
    ScoreSettings as ScoreSettings,
    scorecard as scorecard,
    scorecard_of as scorecard_of,
    scored_run as scored_run,
)
from opir_scoring.sensor_coverage import (
    coverage as coverage,
)
