"""Error codes that `TC` reports."""

from __future__ import annotations

UNKNOWN_COMMAND = 1
OPERAND = 4
OUT_OF_RANGE = 6
WHILE_RUNNING = 7
UNKNOWN_VARIABLE = 9
NOT_JOGGING = 13
MOTOR_OFF = 20
ALREADY_RUNNING = 21
LIMIT_SWITCH = 22
NO_SEQUENCE = 24
SEGMENTS_FULL = 32
TOO_FEW_FIELDS = 50
BAD_BRACES = 53
QUERY_NOT_ALLOWED = 51
BAD_QUOTE = 52
BAD_FUNCTION = 57
BAD_OPERAND = 58
BAD_PARENTHESES = 59
LOST_CONNECTION = 123

TEXTS = {
    0: "",
    UNKNOWN_COMMAND: "Unrecognized command",
    OPERAND: "Operand error",
    5: "Input buffer full",
    OUT_OF_RANGE: "Number out of range",
    WHILE_RUNNING: "Command not valid while running",
    UNKNOWN_VARIABLE: "Variable error",
    NOT_JOGGING: "Jog only while jogging",
    MOTOR_OFF: "Begin not valid with motor off",
    ALREADY_RUNNING: "Begin not valid while running",
    LIMIT_SWITCH: "Begin not possible due to limit switch",
    NO_SEQUENCE: "Begin not valid because no sequence defined",
    SEGMENTS_FULL: "Segment buffer full",
    TOO_FEW_FIELDS: "Not enough fields",
    BAD_BRACES: "Braces wrong",
    QUERY_NOT_ALLOWED: "Question mark not valid here",
    BAD_QUOTE: "Missing quote or string too long",
    BAD_FUNCTION: "Bad function or array",
    BAD_OPERAND: "Bad operand",
    BAD_PARENTHESES: "Parentheses do not match",
    LOST_CONNECTION: "TCP lost sync or timeout",
}
"""Text of each code, in our own words: no client depends on the wording, only on the number before it."""


class CommandError(Exception):
    """A command that the controller answers with `?`; `code` is what `TC` then reports."""

    def __init__(self, code: int) -> None:
        super().__init__(f"{code} {TEXTS.get(code, 'Error')}".strip())
        self.code = code
