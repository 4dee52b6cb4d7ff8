"""Error codes that `TC` reports."""

from __future__ import annotations

UNKNOWN_COMMAND = 1
ONLY_IN_PROGRAM = 2
NOT_IN_PROGRAM = 3
OPERAND = 4
OUT_OF_RANGE = 6
WHILE_RUNNING = 7
UNKNOWN_VARIABLE = 9
UNDEFINED_LABEL = 10
BAD_LINE = 11
STACK_TOO_DEEP = 12
NOT_JOGGING = 13
PROGRAM_RUNNING = 17
WHILE_CONTOURING = 18
THREAD_RUNNING = 19
MOTOR_OFF = 20
ALREADY_RUNNING = 21
LIMIT_SWITCH = 22
NO_SEQUENCE = 24
SEGMENTS_FULL = 32
NO_TIME = 39
CONTOUR_RANGE = 41
TOO_FEW_FIELDS = 50
BAD_BRACES = 53
QUERY_NOT_ALLOWED = 51
BAD_QUOTE = 52
BAD_INDEX = 56
BAD_FUNCTION = 57
BAD_OPERAND = 58
BAD_PARENTHESES = 59
DOWNLOAD = 60
DUPLICATE_LABEL = 61
TOO_MANY_LABELS = 62
NO_ENDIF = 63
ARRAYS_FULL = 66
TOO_MANY_VARIABLES = 67
LOST_CONNECTION = 123

TEXTS = {
    0: "",
    UNKNOWN_COMMAND: "Unrecognized command",
    ONLY_IN_PROGRAM: "Only valid inside a program",
    NOT_IN_PROGRAM: "Not valid inside a program",
    OPERAND: "Operand error",
    5: "Input buffer full",
    OUT_OF_RANGE: "Number out of range",
    WHILE_RUNNING: "Command not valid while running",
    UNKNOWN_VARIABLE: "Variable error",
    UNDEFINED_LABEL: "Empty line or undefined label",
    BAD_LINE: "Bad label or line number",
    STACK_TOO_DEEP: "Subroutine stack too deep",
    NOT_JOGGING: "Jog only while jogging",
    PROGRAM_RUNNING: "Not valid while a program runs",
    WHILE_CONTOURING: "Not valid while contouring",
    THREAD_RUNNING: "Thread already executing",
    MOTOR_OFF: "Begin not valid with motor off",
    ALREADY_RUNNING: "Begin not valid while running",
    LIMIT_SWITCH: "Begin not possible due to limit switch",
    NO_SEQUENCE: "Begin not valid because no sequence defined",
    SEGMENTS_FULL: "Segment buffer full",
    NO_TIME: "No time given",
    CONTOUR_RANGE: "Contour record out of range",
    TOO_FEW_FIELDS: "Not enough fields",
    BAD_BRACES: "Braces wrong",
    QUERY_NOT_ALLOWED: "Question mark not valid here",
    BAD_QUOTE: "Missing quote or string too long",
    BAD_INDEX: "Array index invalid",
    BAD_FUNCTION: "Bad function or array",
    BAD_OPERAND: "Bad operand",
    BAD_PARENTHESES: "Parentheses do not match",
    DOWNLOAD: "Line too long or too many lines",
    DUPLICATE_LABEL: "Duplicate label",
    TOO_MANY_LABELS: "Too many labels",
    NO_ENDIF: "IF without ENDIF",
    ARRAYS_FULL: "Array space full",
    TOO_MANY_VARIABLES: "Too many variables",
    LOST_CONNECTION: "TCP lost sync or timeout",
}
"""Text of each code, in our own words: no client depends on the wording, only on the number before it."""


class CommandError(Exception):
    """A command that the controller answers with `?`; `code` is what `TC` then reports."""

    def __init__(self, code: int) -> None:
        super().__init__(f"{code} {TEXTS.get(code, 'Error')}".strip())
        self.code = code
