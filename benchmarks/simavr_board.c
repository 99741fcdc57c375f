/* A board with two accelerometers around the firmware: an ATmega328P of simavr, its UART on a pseudo-terminal.
 *
 *     simavr_board ELF LINK SENSOR SECONDS SIGNAL RATE_HZ PACE [FAULT]
 *
 * SENSOR is 335 (analog), 345 or 355 (SPI); SIGNAL a file of float32 pairs, base and malleolus [m/s^2], repeated for
 * ever, or `count`: then the converter's reading says which conversion it is. PACE is `real`, or `fast`: as quick as the
 * reader of the terminal, who then never misses a byte. It ends after SECONDS of the board's time or when its standard
 * input closes, and prints one JSON object of what it saw. FAULT `dead1` cuts the cable of the malleolus.
 *
 * simavr's converter knows no start by timer 1, so that the compare match is handed to it here. Its own uart_pty drops
 * bytes when the reader is late, which a measurement of losses must not; so the terminal is served here, too.
 */
#define _GNU_SOURCE
#include <fcntl.h>
#include <math.h>
#include <poll.h>
#include <pty.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include <simavr/avr_adc.h>
#include <simavr/avr_ioport.h>
#include <simavr/avr_spi.h>
#include <simavr/avr_uart.h>
#include <simavr/sim_avr.h>
#include <simavr/sim_elf.h>
#include <simavr/sim_interrupts.h>
#include <simavr/sim_irq.h>
#include <simavr/sim_time.h>

#define CLOCK_HZ 16000000ul
#define COMPARE_B 12 /* its vector, TIMER1_COMPB */
#define G 9.80665

static avr_t *avr;
static int sensor, counting, master, dead = -1;
static float *signal_;
static size_t length;
static double rate_hz;
static avr_irq_t *adc, *spi, *uart;

/* ---- what was seen ---- */
static unsigned long conversions, bytes, dropped, spi_reads;
static avr_cycle_count_t last, shortest = ~0ull, longest;

static void seen(void) {
    if (last && conversions) {
        avr_cycle_count_t since = avr->cycle - last;
        shortest = since < shortest ? since : shortest;
        longest = since > longest ? since : longest;
    }
    last = avr->cycle;
    conversions++;
}

/* ---- the sensors ---- */
static int self_test[2];

static double acceleration(int channel) {
    double at = fmod((double)avr->cycle / CLOCK_HZ * rate_hz, length), part = at - floor(at);
    size_t i = (size_t)at % length, j = (i + 1) % length;
    return signal_[2 * i + channel] * (1 - part) + signal_[2 * j + channel] * part;
}

/* A conversion begins: the pin gets its voltage [mV] of this cycle. */
static void conversion(avr_irq_t *irq, uint32_t value, void *param) {
    unsigned kind = value & 7, pin = value >> 19; /* as avr_adc_mux_t has them */
    if (kind != ADC_MUX_SINGLE || pin > 1)
        return;
    double volts;
    if (!(avr->data[0x7A] & 0x20)) { /* not by the timer: the firmware looks at the sensors */
        conversions = last = 0;
        volts = 1.65 + 0.33 * (self_test[0] ? 1.0 : 0.0);
    } else if (counting) {
        int code = 230 + conversions * 7919 % 563;
        volts = ceil(code * 3300.0 / 1023) / 1e3;
        seen();
    } else {
        volts = 1.65 + 0.33 / G * acceleration(pin);
        seen();
    }
    if (pin == dead)
        volts = 0.01;
    volts = volts < 0 ? 0 : volts > 3.3 ? 3.3 : volts;
    avr_raise_irq(adc + ADC_IRQ_ADC0 + pin, (uint32_t)(1e3 * volts + 0.5));
}

static void compared(avr_irq_t *irq, uint32_t value, void *param) {
    if (value && sensor == 335)
        avr_raise_irq(adc + ADC_IRQ_IN_TRIGGER, 1);
}

/* Registers of two chips on the SPI bus; a transfer is an address and what follows. */
static uint8_t registers[2][64];
static int chosen = -1, address = -1, reading;

static void latch(int c) {
    int counts;
    if (sensor == 345) {
        counts = (int)lround((acceleration(c) / G + (registers[c][0x31] & 0x80 ? 1.0 : 0.0)) * 256);
        registers[c][0x36] = counts;
        registers[c][0x37] = counts >> 8;
    } else {
        counts = (int)lround((acceleration(c) / G + (registers[c][0x2E] == 3 ? 1.5 : 0.0)) * 64000);
        registers[c][0x0E] = counts >> 12;
        registers[c][0x0F] = counts >> 4;
        registers[c][0x10] = counts << 4;
    }
}

static void select_chip(avr_irq_t *irq, uint32_t value, void *param) {
    int channel = (int)(long)param;
    if (!value) {
        chosen = channel;
        address = -1;
    } else if (chosen == channel)
        chosen = -1;
}

static void spi_byte(avr_irq_t *irq, uint32_t value, void *param) {
    uint8_t answer = 0xFF;
    if (chosen >= 0 && chosen != dead) {
        uint8_t *r = registers[chosen];
        if (address < 0) {
            address = sensor == 345 ? value & 0x3F : value >> 1;
            reading = sensor == 345 ? value >> 7 : value & 1;
            if (reading && address == (sensor == 345 ? 0x36 : 0x0E)) {
                latch(chosen);
                if (chosen == 0 && (avr->data[0x6F] & 4)) {
                    seen();
                    spi_reads++;
                }
            }
        } else if (reading)
            answer = r[address++ & 63];
        else
            r[address++ & 63] = value;
    }
    avr_raise_irq(spi + SPI_IRQ_INPUT, answer);
}

static void test_pin(avr_irq_t *irq, uint32_t value, void *param) { self_test[0] = value; }

/* simavr gives every byte 100 us, whatever the clock divider; at 4 MHz it has 32 cycles. */
static void spi_written(avr_t *a, avr_io_addr_t place, uint8_t value, void *param) {
    for (avr_cycle_timer_slot_p slot = a->cycle_timers.timer; slot; slot = slot->next)
        if (slot->param == param) {
            avr_cycle_timer_register(a, 32, slot->timer, param);
            return;
        }
}

/* ---- the line ---- */
static uint8_t waiting[1 << 20];
static size_t kept;
static int fast;

static void deliver(void) {
    while (kept) {
        ssize_t done = write(master, waiting, kept);
        if (done <= 0) {
            if (!fast)
                return;
            struct pollfd ends[2] = {{master, POLLOUT, 0}, {0, POLLIN, 0}};
            poll(ends, 2, 1000);
            if (ends[1].revents)
                return;
            continue;
        }
        kept -= done;
        memmove(waiting, waiting + done, kept);
    }
}

static void sent(avr_irq_t *irq, uint32_t value, void *param) {
    bytes++;
    if (kept == sizeof waiting)
        dropped++;
    else
        waiting[kept++] = value;
}

static void quiet(avr_t *a, const int level, const char *format, va_list list) {}
static void no_sleep(avr_t *a, avr_cycle_count_t cycles) {}

static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec + 1e-9 * t.tv_nsec;
}

int main(int argc, char **argv) {
    if (argc < 8)
        return 2;
    sensor = atoi(argv[3]);
    double seconds = atof(argv[4]);
    rate_hz = atof(argv[6]);
    fast = !strcmp(argv[7], "fast");
    if (argc > 8 && !strcmp(argv[8], "dead1"))
        dead = 1;
    counting = !strcmp(argv[5], "count");
    if (!counting) {
        FILE *file = fopen(argv[5], "rb");
        if (!file)
            return 2;
        fseek(file, 0, SEEK_END);
        length = ftell(file) / 8;
        rewind(file);
        signal_ = malloc(8 * length);
        if (!length || fread(signal_, 8, length, file) != length)
            return 2;
        fclose(file);
    }
    FILE *out = fdopen(dup(1), "w"); /* simavr prints; what it says goes nowhere */
    if (!out || !freopen("/dev/null", "w", stdout))
        return 2;
    avr_global_logger_set(quiet);
    elf_firmware_t firmware = {};
    if (elf_read_firmware(argv[1], &firmware))
        return 2;
    avr = avr_make_mcu_by_name("atmega328p");
    avr_init(avr);
    firmware.frequency = CLOCK_HZ;
    avr_load_firmware(avr, &firmware);
    avr->vcc = avr->avcc = 5000;
    avr->aref = 3300;
    avr->sleep = no_sleep;

    uint32_t flags = 0;
    avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags);
    uart = avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), 0);
    avr_irq_register_notify(uart + UART_IRQ_OUTPUT, sent, NULL);
    adc = avr_io_getirq(avr, AVR_IOCTL_ADC_GETIRQ, 0);
    avr_irq_register_notify(adc + ADC_IRQ_OUT_TRIGGER, conversion, NULL);
    avr_irq_register_notify(avr_get_interrupt_irq(avr, COMPARE_B), compared, NULL);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ('D'), 4), test_pin, NULL);
    if (sensor != 335) {
        void *spi_module = NULL;
        spi = avr_io_getirq(avr, AVR_IOCTL_SPI_GETIRQ(0), 0);
        avr_irq_register_notify(spi + SPI_IRQ_OUTPUT, spi_byte, NULL);
        avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ('B'), 2), select_chip, (void *)0);
        avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ('B'), 0), select_chip, (void *)1);
        for (avr_io_t *io = avr->io_port; io; io = io->next)
            if (!strcmp(io->kind, "spi"))
                spi_module = io;
        avr_register_io_write(avr, 0x4E, spi_written, spi_module);
        for (int c = 0; c < 2; c++)
            memcpy(registers[c], sensor == 345 ? "\xE5\0\0" : "\xAD\x1D\xED", 3);
    }

    int slave;
    char name[128];
    struct termios raw;
    if (openpty(&master, &slave, name, NULL, NULL))
        return 2;
    tcgetattr(slave, &raw);
    cfmakeraw(&raw);
    tcsetattr(slave, TCSANOW, &raw);
    fcntl(master, F_SETFL, O_NONBLOCK);
    if (symlink(name, argv[2]))
        return 2;

    double start = now();
    avr_cycle_count_t end = (avr_cycle_count_t)(seconds * CLOCK_HZ), next = 0;
    while (avr->cycle < end && avr->state != cpu_Done && avr->state != cpu_Crashed) {
        if (avr->cycle >= next) {
            next = avr->cycle + CLOCK_HZ / 500;
            uint8_t byte;
            deliver();
            while (read(master, &byte, 1) == 1)
                avr_raise_irq(uart + UART_IRQ_INPUT, byte);
            double ahead = (double)avr->cycle / CLOCK_HZ - (now() - start);
            struct pollfd ends[1] = {{0, POLLIN, 0}};
            if (poll(ends, 1, fast || ahead < 1e-3 ? 0 : (int)(1e3 * ahead)) > 0 && read(0, &byte, 1) <= 0)
                break;
        }
        avr_run(avr);
    }
    deliver();
    unlink(argv[2]);
    fprintf(out,
            "{\"cycles\": %llu, \"conversions\": %lu, \"shortest_cycles\": %llu, \"longest_cycles\": %llu, "
            "\"bytes\": %lu, \"dropped\": %lu, \"state\": %d, \"wall_s\": %.3f}\n",
            (unsigned long long)avr->cycle, conversions, (unsigned long long)shortest, (unsigned long long)longest,
            bytes, dropped, avr->state, now() - start);
    fclose(out);
    if (fast)
        poll(NULL, 0, 500); /* the reader may still fetch what the terminal holds */
    return 0;
}
