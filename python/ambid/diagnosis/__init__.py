"""What the model lacks: compare, localise, rank the candidates, add what the data support, and say what was found."""

from ambid.diagnosis.by_excitation import MisfitMatrix, misfit_matrix
from ambid.diagnosis.candidates import Candidate, Ranking
from ambid.diagnosis.localisation import Localisation, localise, misfit_maps
from ambid.diagnosis.ports import measured_shape
from ambid.diagnosis.prediction import Prediction, predict
from ambid.diagnosis.procedure import diagnose
from ambid.diagnosis.ranking import rank
from ambid.diagnosis.result import Diagnosis, Step
from ambid.diagnosis.standing import holders
from ambid.noise import Comparison, compare

__all__ = [
    "Candidate",
    "Comparison",
    "Diagnosis",
    "Localisation",
    "MisfitMatrix",
    "Prediction",
    "Ranking",
    "Step",
    "compare",
    "diagnose",
    "holders",
    "localise",
    "measured_shape",
    "misfit_maps",
    "misfit_matrix",
    "predict",
    "rank",
]
