// UART baud rate settings in double speed mode.
#ifndef BAUD_H
#define BAUD_H

#define BAUD_REGISTER(baud) ((F_CPU / 4 / (baud) - 1) / 2)
#define BAUD_REACHED(baud) (F_CPU / 8 / (BAUD_REGISTER(baud) + 1))

// Both ends may be off; eight data bits tolerate 2.5 %.
#define BAUD_FITS(baud) \
  (BAUD_REACHED(baud) * 40 > (baud)*39UL && BAUD_REACHED(baud) * 40 < (baud)*41UL)

#endif
