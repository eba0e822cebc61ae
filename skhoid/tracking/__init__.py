"""Methods that follow a varying operator, beside the recursion of ``arx``.

Open it to add one: models of the ARX form have ``coef_path_``, those that one recursion follows
build on :class:`~skhoid.arx.recursive.OneRecursion`, physical ones on
:class:`~skhoid.tracking.operator_path.OperatorPath`.
"""
