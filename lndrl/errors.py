"""The one error that users see: a sentence that says what, where and what would be right."""


class UserError(Exception):
    """Input that the user can mend.

    The message is one clear sentence: what was wrong, where (file, key, line), and what would
    be right. The command line prints it without a traceback and exits with code 2.
    """
