"""Methods that follow a varying operator, beside the recursion of ``arx``.

Open it to add one: models of the ARX form have ``coef_path_``, physical ones build on
:class:`~skhoid.tracking.operator_path.OperatorPath`; what streams builds on
:class:`~skhoid.arx.streaming.Follower`.
"""
