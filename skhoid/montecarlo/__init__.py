"""Monte-Carlo studies."""

from .blocks import Block, DataSet
from .catalogue import PAPER_STUDIES, PaperStudy, paper_study
from .declared import identified_as
from .delays import delay_study
from .experiment import analyse_experiment, simulate_experiment
from .experiment_result import ExperimentResult
from .forgetting import forgetting_study
from .paper import Claim, StudyResult
from .paths import path_study
from .recommend import ForgettingAdvice, recommend_forgetting
from .responses import response_study
from .study import MonteCarloStudy
from .summary import summarize

__all__ = [
    "PAPER_STUDIES",
    "Block",
    "Claim",
    "DataSet",
    "ExperimentResult",
    "ForgettingAdvice",
    "MonteCarloStudy",
    "PaperStudy",
    "StudyResult",
    "analyse_experiment",
    "delay_study",
    "forgetting_study",
    "identified_as",
    "paper_study",
    "path_study",
    "recommend_forgetting",
    "response_study",
    "simulate_experiment",
    "summarize",
]
