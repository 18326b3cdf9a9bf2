"""The practical size of made-up rivals and screenings whose size is not in question: every effect reaches it."""

from idic.diagnose.screen.practical import PracticalSize

ANY_SIZE = PracticalSize(px=-1.0, channel_std=-1.0)
