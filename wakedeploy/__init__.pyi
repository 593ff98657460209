from wakedeploy.api.flights import Flight as Flight
from wakedeploy.api.flights import Flights as Flights
from wakedeploy.api.flights import fly as fly
from wakedeploy.api.gaps import Gap as Gap
from wakedeploy.api.gaps import close_gap as close_gap
from wakedeploy.api.predictors import Predictor as Predictor
from wakedeploy.api.predictors import export as export
from wakedeploy.api.predictors import load as load
from wakedeploy.api.scores import Scores as Scores
from wakedeploy.api.sets import import_set as import_set
from wakedeploy.api.sets import make_set as make_set
from wakedeploy.api.training import Runs as Runs
from wakedeploy.api.training import evaluate as evaluate
from wakedeploy.api.training import train as train
from wakedeploy.api.tuning import Tuned as Tuned
from wakedeploy.api.tuning import tune as tune
from wakedeploy.core.episodes import Channel as Channel
from wakedeploy.core.episodes import Episode as Episode
from wakedeploy.core.episodes import EpisodeSet as EpisodeSet
from wakedeploy.core.errors import CheckFailed as CheckFailed
from wakedeploy.core.errors import UnusableInput as UnusableInput
from wakedeploy.core.errors import WakedeployError as WakedeployError
from wakedeploy.core.rig import Rig as Rig
from wakedeploy.rig.file import default_rig as default_rig
from wakedeploy.rig.file import read_rig as read_rig
from wakedeploy.rig.file import with_effect as with_effect

__version__: str
