"""``devkit check``: does a stack keep the rules that make verdicts repeatable?"""
