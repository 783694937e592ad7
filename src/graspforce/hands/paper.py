"""x"""


class PaperHand: ...
