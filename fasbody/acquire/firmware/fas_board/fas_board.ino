// Two accelerometers on an ATmega328P (Arduino Uno, Nano), sent to `fasbody record --baud 500000`.
//
// Open this file in the Arduino IDE and upload it; no library is needed. Wiring, parts and the format of the frames are
// in docs/acquisition.md. Timer 1 alone says when a sample is taken: its compare match B starts each conversion of the
// converter in hardware, or reads the sensors on the SPI bus. Nothing that the program does moves a sample in time.
//
// Commands, each a line: ? (who are you), stop, start, test (the sensors' own test, then start).

#include <avr/eeprom.h>
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>
#include <string.h>
#include <util/atomic.h>
#include <util/crc16.h>
#include <util/delay.h>

// ---- what you have ------------------------------------------------------------------------------------------------

#define ANALOG 335   // ADXL335 or another analog pair, on A0 (base) and A1 (malleolus), 3.3 V on AREF
#define ADXL345 345  // on the SPI bus; its clock is its own, so that the two are up to 0.3 ms apart
#define ADXL355 355  // on the SPI bus, in step with timer 1 through their pins DRDY

#ifndef SENSOR
#define SENSOR ANALOG
#endif
#ifndef RATE_HZ
#define RATE_HZ 1000  // samples a second; 2000 is the highest, with half the readings in each
#endif
#ifndef BAUD_RATE
#define BAUD_RATE 500000UL  // 16 MHz give this rate exactly, and 115200 only to 2 %
#endif

// Sensitivity of each sensor by itself: volts (analog, at 3.3 V) or counts (SPI) per g. PER_G is the data sheet's; by
// turning the sensor over you know it better. It is negative if the sensor is mounted upside down.
#ifndef BASE_PER_G
#define BASE_PER_G (+PER_G)
#endif
#ifndef MALLEOLUS_PER_G
#define MALLEOLUS_PER_G (+PER_G)
#endif
#define REFERENCE_V 3.3     // of the analog pair
#define ANALOG_RANGE_G 3.0  // either way
#define SELF_TEST_WIRED 1  // D4 to the ST pins of both, through a divider to 3.3 V; 0 if it is not

// ---- derived ------------------------------------------------------------------------------------------------------

#define G 9.80665f
#define CHANNELS 2
#define SAMPLES 16  // in a frame
#if SENSOR == ANALOG
// 125 kHz, within the 200 kHz up to which the converter has its ten bits; a conversion takes 108 us, a turn 125.
#define TICK_HZ 8000UL
#define READINGS (TICK_HZ / RATE_HZ / CHANNELS)
// base, malleolus, m, b, m, b, b, m: the mean time of both is the same, of eight also its mean square, so that the one
// converter puts no phase and no amplitude between them. Of four it is the first half.
#define TURNS 0x96
#define ZERO (512 * (int16_t)READINGS)
#define PER_G 0.330  // ADXL335
#define COUNTS_PER_M_S2(per_g) ((float)((per_g) / REFERENCE_V * 1024 * READINGS) / G)
#define RANGE_M_S2(per_g) ((float)ANALOG_RANGE_G * G)
#define BITS 16
#define LOWEST_READING 2
#define HIGHEST_READING 1021
#define NAME "fas analog"
#elif SENSOR == ADXL345
#define TICK_HZ RATE_HZ
#define PER_G 256
#define FULL_COUNTS 4093  // 15.99 g
#define BITS 16
#define NAME "fas ADXL345"
#elif SENSOR == ADXL355
#define TICK_HZ RATE_HZ
#define PER_G 64000
#define FULL_COUNTS 524160  // 8.19 g
#define BITS 24
#define NAME "fas ADXL355"
#endif
#if SENSOR != ANALOG
#define COUNTS_PER_M_S2(per_g) ((float)(per_g) / G)
#define RANGE_M_S2(per_g) (FULL_COUNTS * G / ((per_g) < 0 ? -(float)(per_g) : (float)(per_g)))
#endif
// In the flags of a frame: a sensor was over range, and which.
#define OVER(channel) (_BV(0) | _BV(1 + (channel)))
#define WIDTH (BITS / 8)
#define TICK_US (1000000UL / TICK_HZ)
#define DATA_BYTES (SAMPLES * CHANNELS * WIDTH)
#define CHECK_BYTES 4

#if F_CPU % (8 * BAUD_RATE) || F_CPU % TICK_HZ || 1000000UL % TICK_HZ
#error "this clock cannot make this baud rate or this sampling rate exactly"
#endif
#if RATE_HZ != 1000 && RATE_HZ != 2000
#error "RATE_HZ is 1000 or 2000"
#endif

// Bit 2 of port B is D10, chip select of the base; bit 0 is D8, of the malleolus; bit 1 is D9, the sensors' step.
static const uint8_t SELECT[CHANNELS] = {_BV(PB2), _BV(PB0)};

// ---- bytes to the computer ----------------------------------------------------------------------------------------

static uint8_t queue[256];  // its indices run over by themselves
static volatile uint8_t queue_in, queue_out;

ISR(USART_UDRE_vect) {
    if (queue_out == queue_in)
        UCSR0B &= ~_BV(UDRIE0);
    else
        UDR0 = queue[queue_out++];
}

static void put(uint8_t byte) {
    while ((uint8_t)(queue_in + 1) == queue_out) {
    }
    queue[queue_in] = byte;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        queue_in++;
        UCSR0B |= _BV(UDRIE0);
    }
}

// Both check words behind the payload, which has room for them, then COBS between two zero bytes.
static void send_frame(uint8_t *payload, uint8_t size) {
    uint16_t ccitt = 0xFFFF, modbus = 0xFFFF;
    for (uint8_t i = 0; i < size; i++) {
        ccitt = _crc_xmodem_update(ccitt, payload[i]);
        modbus = _crc16_update(modbus, payload[i]);
    }
    memcpy(payload + size, &ccitt, 2);
    memcpy(payload + size + 2, &modbus, 2);
    size += CHECK_BYTES;
    put(0);
    for (uint8_t i = 0;; i++) {
        uint8_t run = 0;
        while (i + run < size && payload[i + run])
            run++;
        put(run + 1);
        while (run--)
            put(payload[i++]);
        if (i >= size)
            break;
    }
    put(0);
}

// ---- samples ------------------------------------------------------------------------------------------------------

// A data frame as it is sent; the AVR puts nothing between the fields.
struct Frame {
    uint8_t type, flags;
    uint32_t sequence, time_us;
    uint8_t data[DATA_BYTES];
    uint8_t checks[CHECK_BYTES];
};

static struct Frame frames[2];
static volatile uint8_t filling, full;  // which of the two is being filled; whether the other waits to be sent
static uint8_t fill, over;
static uint32_t ticks, sequence;
static uint16_t boot;

static void store(const int32_t *counts) {
    struct Frame *frame = &frames[filling];
    if (fill == 0)
        frame->time_us = ticks * TICK_US;
    for (uint8_t channel = 0; channel < CHANNELS; channel++) {
        memcpy(frame->data + fill, &counts[channel], WIDTH);
        fill += WIDTH;
    }
    if (fill < DATA_BYTES)
        return;
    frame->type = 'D';
    frame->flags = over;
    frame->sequence = sequence++;
    fill = over = 0;
    if (!full) {  // otherwise this frame is dropped, and its number says so
        filling ^= 1;
        full = 1;
    }
}

#if SENSOR == ANALOG

static uint16_t sums[CHANNELS];
static uint8_t turn;

// Its flag, which starts the conversion, is cleared by coming here.
ISR(TIMER1_COMPB_vect) { ticks++; }

ISR(ADC_vect) {
    static uint8_t turns;
    uint16_t reading = ADC;
    if (turn == 0)
        turns = TURNS;
    sums[turns & 1] += reading;
    if (reading < LOWEST_READING || reading > HIGHEST_READING)
        over |= turns & 1 ? OVER(1) : OVER(0);
    turns >>= 1;
    if (++turn < CHANNELS * READINGS) {
        ADMUX = turns & 1;  // for the next conversion; the reference is the pin AREF
        return;
    }
    ADMUX = turn = 0;
    int32_t counts[CHANNELS];
    for (uint8_t channel = 0; channel < CHANNELS; channel++) {
        counts[channel] = (int16_t)sums[channel] - ZERO;
        sums[channel] = 0;
    }
    store(counts);
}

static uint16_t convert(uint8_t mux) {
    ADMUX = mux;
    _delay_us(200);
    ADCSRA = _BV(ADEN) | _BV(ADSC) | 7;
    while (ADCSRA & _BV(ADSC)) {
    }
    return ADC;
}

// Lets the first conversion be of the base, and every one after it be started by timer 1.
static void prepare(void) {
    DDRD |= _BV(PD4);
    turn = 0;
    sums[0] = sums[1] = 0;
    convert(0);  // the first after a change is thrown away
    ADCSRB = _BV(ADTS2) | _BV(ADTS0);
    ADCSRA = _BV(ADEN) | _BV(ADATE) | _BV(ADIF) | _BV(ADIE) | 7;
}

static int32_t look(uint8_t channel) { return convert(channel); }

static int32_t level(uint8_t channel);

// The internal 1.1 V against AREF, then a level that a connected sensor at rest has; ST moves it by 150 mV or more.
static uint8_t test(uint8_t channel) {
    DDRD |= _BV(PD4);
    convert(14);
    uint16_t bandgap = convert(14), expected = 1.1 / REFERENCE_V * 1024;
    int32_t rest = level(channel);
    if (bandgap < expected / 5 * 4 || bandgap > expected / 5 * 6 || rest < 100 || rest > 924)
        return 0;
    if (!SELF_TEST_WIRED)
        return 1;
    PORTD |= _BV(PD4);
    _delay_ms(20);
    int32_t moved = level(channel) - rest;
    PORTD &= ~_BV(PD4);
    _delay_ms(20);
    return (moved < 0 ? -moved : moved) > (int32_t)(0.1 / REFERENCE_V * 1024);
}

#else

static uint8_t exchange(uint8_t byte) {
    SPDR = byte;
    while (!(SPSR & _BV(SPIF))) {
    }
    return SPDR;
}

#if SENSOR == ADXL345
#define READ(reg) (0xC0 | (reg))  // and go on to the next register
#define WRITE(reg) (reg)
#define SPI_MODE (_BV(CPOL) | _BV(CPHA))
#define Z_REGISTER 0x36
#define Z_BYTES 2
#else
#define READ(reg) ((reg) << 1 | 1)
#define WRITE(reg) ((reg) << 1)
#define SPI_MODE 0
#define Z_REGISTER 0x0E
#define Z_BYTES 3
#endif

static void read_from(uint8_t channel, uint8_t reg, uint8_t *to, uint8_t size) {
    PORTB &= ~SELECT[channel];
    exchange(READ(reg));
    while (size--)
        *to++ = exchange(0);
    PORTB |= SELECT[channel];
}

static void write_to(uint8_t channel, uint8_t reg, uint8_t value) {
    PORTB &= ~SELECT[channel];
    exchange(WRITE(reg));
    exchange(value);
    PORTB |= SELECT[channel];
}

static int32_t look(uint8_t channel) {
    uint8_t raw[Z_BYTES];
    read_from(channel, Z_REGISTER, raw, Z_BYTES);
#if SENSOR == ADXL345
    return (int16_t)(raw[1] << 8 | raw[0]);
#else
    // twenty bits, first byte highest; the shift brings the sign down
    return (int32_t)((uint32_t)raw[0] << 24 | (uint32_t)raw[1] << 16 | (uint32_t)raw[2] << 8) >> 12;
#endif
}

ISR(TIMER1_COMPB_vect) {
    ticks++;
    int32_t counts[CHANNELS];
    for (uint8_t channel = 0; channel < CHANNELS; channel++) {
        counts[channel] = look(channel);
        if (counts[channel] >= FULL_COUNTS || counts[channel] <= -FULL_COUNTS)
            over |= channel ? OVER(1) : OVER(0);
    }
    store(counts);
}

static int32_t level(uint8_t channel);

// Before anything is read: D9 gives a pulse at every sample, to which the ADXL355 keep.
static void prepare(void) {
    for (uint8_t channel = 0; channel < CHANNELS; channel++) {
#if SENSOR == ADXL345
        write_to(channel, 0x31, 0x0B);  // +-16 g in full resolution
        write_to(channel, 0x2C, 0x0F);  // 3200 Hz
        write_to(channel, 0x2D, 0x08);  // measure
#else
        write_to(channel, 0x2D, 0x01);  // standby, in which the rest can be set
        write_to(channel, 0x2C, 0x83);  // +-8 g
        write_to(channel, 0x28, RATE_HZ == 2000 ? 1 : 2);
        write_to(channel, 0x2B, 0x02);  // in step with the pulses, by its interpolation filter
        write_to(channel, 0x2D, 0x00);  // measure
#endif
    }
}

static uint8_t test(uint8_t channel) {
    uint8_t id[3];
    DDRB |= _BV(PB0) | _BV(PB1) | _BV(PB2) | _BV(PB3) | _BV(PB5);
    PORTB |= SELECT[0] | SELECT[1];
    SPCR = _BV(SPE) | _BV(MSTR) | SPI_MODE;  // 4 MHz
    _delay_ms(10);
    read_from(channel, 0, id, 3);
#if SENSOR == ADXL345
    if (id[0] != 0xE5)
        return 0;
#else
    if (id[0] != 0xAD || id[1] != 0x1D || id[2] != 0xED)
        return 0;
#endif
    prepare();
#if SENSOR == ADXL355
    write_to(channel, 0x2D, 0x01);  // standby, in which alone the mode may be set
    write_to(channel, 0x2B, 0x00);  // there are no pulses yet
    write_to(channel, 0x2D, 0x04);  // measure, with DRDY off: D9 holds that line
#endif
    _delay_ms(50);
    int32_t rest = level(channel);
#if SENSOR == ADXL345
    write_to(channel, 0x31, 0x8B);
#else
    write_to(channel, 0x2E, 0x03);
#endif
    _delay_ms(50);
    int32_t moved = level(channel) - rest;
#if SENSOR == ADXL355
    write_to(channel, 0x2E, 0x00);
#endif
    prepare();
    _delay_ms(50);
    return (moved < 0 ? -moved : moved) > (int32_t)(0.1f * PER_G);
}

#endif

// Mean of an eighth of a second, so that a test succeeds on a base that is not quite at rest.
static int32_t level(uint8_t channel) {
    int32_t sum = 0;
    for (uint8_t i = 0; i < 128; i++) {
        sum += look(channel);
        _delay_ms(1);
    }
    return sum / 128;
}

// ---- the board ----------------------------------------------------------------------------------------------------

static char board_name[32];
static uint8_t running;

static void stop(void) {
    TIMSK1 = TCCR1B = 0;
#if SENSOR == ANALOG
    ADCSRA = 0;
#endif
    running = 0;
}

static void say_hello(void) {
    static const float range[CHANNELS] = {RANGE_M_S2(BASE_PER_G), RANGE_M_S2(MALLEOLUS_PER_G)};
    static const float sensitivity[CHANNELS] = {COUNTS_PER_M_S2(BASE_PER_G), COUNTS_PER_M_S2(MALLEOLUS_PER_G)};
    struct {
        uint8_t type, version, bits, channels;
        uint16_t samples;
        uint32_t rate_mhz;
        uint16_t boot;
        struct {
            uint8_t role;
            float range, counts_per_m_s2;
        } of[CHANNELS];
        char name[sizeof board_name];
        uint8_t checks[CHECK_BYTES];
    } hello = {};
    hello.type = 'H';
    hello.version = 1;
    hello.bits = BITS;
    hello.channels = CHANNELS;
    hello.samples = SAMPLES;
    hello.rate_mhz = 1000UL * RATE_HZ;
    hello.boot = boot;
    for (uint8_t channel = 0; channel < CHANNELS; channel++) {
        hello.of[channel].role = channel;
        hello.of[channel].range = range[channel];
        hello.of[channel].counts_per_m_s2 = sensitivity[channel];
    }
    uint8_t length = strlen(board_name);
    memcpy(hello.name, board_name, length);
    send_frame((uint8_t *)&hello, sizeof hello - sizeof hello.name - CHECK_BYTES + length);
}

// From sample 0 on, with another boot number: the computer then knows that what came before is over.
static void start(void) {
    stop();
    boot++;
    filling = full = fill = over = 0;
    ticks = sequence = 0;
    prepare();
    say_hello();
    ICR1 = F_CPU / TICK_HZ - 1;
    OCR1A = F_CPU / TICK_HZ / 2;
    OCR1B = F_CPU / TICK_HZ - 2;
    TCNT1 = 0;
    TIFR1 = _BV(OCF1B);
    TIMSK1 = _BV(OCIE1B);
    TCCR1A = (SENSOR == ADXL355 ? _BV(COM1A1) : 0) | _BV(WGM11);
    TCCR1B = _BV(WGM13) | _BV(WGM12) | _BV(CS10);  // counts from 0 to ICR1, once a cycle
    running = 1;
}

static void test_all(void) {
    stop();
    uint8_t base = test(0), malleolus = test(1);
    strcpy(board_name, NAME);
    if (!base || !malleolus)
        strcat(board_name, base ? ", FAILED: malleolus" : malleolus ? ", FAILED: base" : ", FAILED: both");
}

static void obey(const char *line) {
    if (!strcmp(line, "?"))
        say_hello();
    else if (!strcmp(line, "stop"))
        stop();
    else if (!strcmp(line, "start"))
        start();
    else if (!strcmp(line, "test")) {
        test_all();
        start();
    }
}

static char line[8];
static volatile uint8_t heard;  // a whole line waits; what comes meanwhile is dropped

ISR(USART_RX_vect) {
    static uint8_t length;
    char byte = UDR0;
    if (heard)
        return;
    if (byte == '\n' || byte == '\r') {
        heard = length > 0 && length < sizeof line;
        line[length < sizeof line ? length : 0] = 0;
        length = 0;
    } else if (length < sizeof line) {
        line[length++] = byte;  // a longer line is no command: length stays at the size
    }
}

int main(void) {
    UBRR0 = F_CPU / 8 / BAUD_RATE - 1;
    UCSR0A = _BV(U2X0);
    UCSR0C = _BV(UCSZ01) | _BV(UCSZ00);
    UCSR0B = _BV(RXEN0) | _BV(TXEN0) | _BV(RXCIE0);
    boot = eeprom_read_word((uint16_t *)0);
    eeprom_write_word((uint16_t *)0, boot + 256);  // the low byte counts the starts in between
    set_sleep_mode(SLEEP_MODE_IDLE);
    sei();
    test_all();
    start();
    for (uint16_t sent = 0;;) {
        cli();
        if (!heard && !full) {
            sleep_enable();
            sei();  // holds after the next instruction only, so that no interrupt comes between
            sleep_cpu();
            sleep_disable();
        }
        sei();
        if (full) {
            struct Frame *frame = &frames[filling ^ 1];
            send_frame((uint8_t *)frame, sizeof *frame - CHECK_BYTES);
            full = 0;
            if (++sent >= RATE_HZ / SAMPLES) {
                sent = 0;
                say_hello();
            }
        }
        if (heard) {
            obey(line);
            heard = 0;
        }
    }
}
