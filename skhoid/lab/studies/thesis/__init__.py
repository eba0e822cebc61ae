"""The Monte-Carlo studies of the thesis, and how their results compare with it."""

from .delays import delay_study
from .parameter_paths import path_study
from .responses import response_study
from .studies import PAPER_STUDIES, PaperStudy, paper_study
from .study_result import Claim, StudyResult
from .trade_off import forgetting_study

__all__ = [
    "PAPER_STUDIES",
    "Claim",
    "PaperStudy",
    "StudyResult",
    "delay_study",
    "forgetting_study",
    "paper_study",
    "path_study",
    "response_study",
]
