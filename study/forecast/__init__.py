"""What catalogues to come will tell, in one table."""

from study.forecast._forecast import SURVEYS, SecondEpoch, Survey, SurveyForecast, forecast_surveys

__all__ = ["SURVEYS", "SecondEpoch", "Survey", "SurveyForecast", "forecast_surveys"]
