/* A back end in Python: one interpreter per instance, spoken to over a socket.
 *
 * Every message is a Message and `size` bytes. The first comes from the worker: whether the
 * component could be made. Then each call of the front end is a request and its reply. Both ends
 * are of one machine: bytes are in its order. See orchestrator/export/worker for the other end.
 *
 * The worker has a process group of its own (Ctrl-C is the host's affair), /dev/null as standard
 * input and the host's standard error as output. It ends when the socket does.
 */
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "backend.h"
#include "model.h"

#ifndef SOCK_CLOEXEC
#define SOCK_CLOEXEC 0
#endif
#ifndef MSG_NOSIGNAL
#define MSG_NOSIGNAL 0 /* macOS: SO_NOSIGPIPE instead */
#endif

enum { OK, WARNING, DISCARD, ERROR, FATAL };
enum { INITIALIZE = 1, STEP, OUTPUTS, GET_STATE, SET_STATE };
enum { CHANNEL = 3, PATIENCE_S = 300, FAREWELL_MS = 5000 };

typedef struct {
    int32_t what;  /* of a request: which call; of a reply: its status */
    uint32_t logs; /* of a reply: how many log records come first */
    uint64_t size;
} Message;

struct Backend {
    pid_t worker, owner; /* a fork of the host must neither end nor await the worker */
    int channel;         /* -1 after it broke */
    uint8_t *buffer;
    size_t capacity, used;
    LogFunction log;
    void *environment;
};

extern char **environ;

static int tell(const Backend *self, int status, const char *message) {
    self->log(self->environment, status, NULL, message);
    return status;
}

/* -- the socket ----------------------------------------------------------------------------------- */

static int64_t milliseconds(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (int64_t)now.tv_sec * 1000 + now.tv_nsec / 1000000;
}

/* Wait for the worker to end, at most so long; then end it. Its wait status, or -1. */
static int reap(Backend *self, int patience_ms) {
    int status = -1;
    pid_t found = 0;
    const int64_t until = milliseconds() + patience_ms;
    while ((found = waitpid(self->worker, &status, WNOHANG)) == 0 || (found < 0 && errno == EINTR)) {
        if (milliseconds() > until) {
            kill(self->worker, SIGKILL);
            while ((found = waitpid(self->worker, &status, 0)) < 0 && errno == EINTR) {}
            break;
        }
        nanosleep(&(struct timespec){0, 1000000}, NULL);
    }
    self->worker = 0;
    return found > 0 ? status : -1; /* -1: the host awaits all children itself */
}

/* The worker is gone, or not to be understood: Fatal, and why. */
static int broken(Backend *self, const char *during) {
    char message[200];
    close(self->channel);
    self->channel = -1;
    int status = self->owner == getpid() ? reap(self, 1000) : -1;
    if (status >= 0 && WIFEXITED(status))
        snprintf(message, sizeof message, "the worker ended during %s, with exit code %d", during,
                 WEXITSTATUS(status));
    else if (status >= 0 && WIFSIGNALED(status))
        snprintf(message, sizeof message, "the worker died during %s, of signal %d (%s)", during,
                 WTERMSIG(status), strsignal(WTERMSIG(status)));
    else snprintf(message, sizeof message, "the worker was lost during %s", during);
    return tell(self, FATAL, message);
}

static int send_all(Backend *self, const uint8_t *bytes, size_t n) {
    while (n) {
        ssize_t sent = send(self->channel, bytes, n, MSG_NOSIGNAL);
        if (sent < 0 && errno == EINTR) continue;
        if (sent <= 0) return 0;
        bytes += sent;
        n -= (size_t)sent;
    }
    return 1;
}

static int receive_all(Backend *self, void *to, size_t n) {
    uint8_t *bytes = to;
    while (n) {
        ssize_t got = recv(self->channel, bytes, n, MSG_WAITALL);
        if (got < 0 && errno == EINTR) continue;
        if (got <= 0) return 0;
        bytes += got;
        n -= (size_t)got;
    }
    return 1;
}

/* -- messages ------------------------------------------------------------------------------------- */

static int reserve(Backend *self, size_t n) {
    if (n <= self->capacity) return 1;
    size_t capacity = 2 * n;
    uint8_t *buffer = realloc(self->buffer, capacity);
    if (!buffer) return 0;
    self->buffer = buffer;
    self->capacity = capacity;
    return 1;
}

static int append(Backend *self, const void *bytes, size_t n) {
    if (!n) return 1;
    if (!reserve(self, self->used + n)) return 0;
    memcpy(self->buffer + self->used, bytes, n);
    self->used += n;
    return 1;
}

/* Begin a request: the header, whose size is filled in by exchange(). */
static int begin(Backend *self, int32_t what) {
    Message header = {what, 0, 0};
    self->used = 0;
    return append(self, &header, sizeof header);
}

static int append_values(Backend *self, const Values *values) {
    int enough = append(self, values->reals, S_REALS * sizeof(double)) &&
                 append(self, values->integers, S_INTEGERS * sizeof(int64_t)) &&
                 append(self, values->changed, N_VARIABLES);
    for (size_t i = 0; enough && i < S_STRINGS; i++) {
        uint32_t n = (uint32_t)strlen(values->strings[i]);
        enough = append(self, &n, sizeof n) && append(self, values->strings[i], n);
    }
    return enough;
}

/* Receive a reply into the buffer and pass its log records on. *rest is what follows them. */
static int receive(Backend *self, const char *during, uint8_t **rest, size_t *n) {
    Message header;
    if (!receive_all(self, &header, sizeof header)) return broken(self, during);
    if (!reserve(self, header.size)) return tell(self, FATAL, "out of memory");
    if (!receive_all(self, self->buffer, header.size)) return broken(self, during);
    uint8_t *at = self->buffer, *end = at + header.size;
    for (uint32_t i = 0; i < header.logs; i++) { /* status, length with the final zero, text */
        uint32_t record[2];
        if ((size_t)(end - at) < sizeof record) return broken(self, during);
        memcpy(record, at, sizeof record);
        at += sizeof record;
        if ((size_t)(end - at) < record[1] || !record[1] || at[record[1] - 1]) return broken(self, during);
        self->log(self->environment, (int)record[0], NULL, (const char *)at);
        at += record[1];
    }
    *rest = at;
    *n = (size_t)(end - at);
    return header.what;
}

static int exchange(Backend *self, const char *during, int enough, uint8_t **rest, size_t *n) {
    if (self->channel < 0) return tell(self, FATAL, "the worker is gone");
    if (!enough) return tell(self, ERROR, "out of memory");
    const uint64_t size = self->used - sizeof(Message);
    memcpy(self->buffer + offsetof(Message, size), &size, sizeof size);
    if (!send_all(self, self->buffer, self->used)) return broken(self, during);
    return receive(self, during, rest, n);
}

/* The computed values, as the worker sent them. */
static int take_values(Backend *self, const char *during, Values *values, uint8_t *at, size_t n) {
    const size_t reals = (N_REALS - S_REALS) * sizeof(double);
    const size_t integers = (N_INTEGERS - S_INTEGERS) * sizeof(int64_t);
    if (n < reals + integers) return broken(self, during);
    memcpy(values->reals + S_REALS, at, reals);
    memcpy(values->integers + S_INTEGERS, at + reals, integers);
    at += reals + integers;
    n -= reals + integers;
    for (size_t i = S_STRINGS; i < N_STRINGS; i++) {
        uint8_t *end = memchr(at, 0, n);
        if (!end) return broken(self, during);
        if (!replace_string(&values->strings[i], (const char *)at))
            return tell(self, FATAL, "out of memory");
        n -= (size_t)(end + 1 - at);
        at = end + 1;
    }
    return n ? broken(self, during) : OK;
}

static int call(Backend *self, const char *during, Values *values, int enough) {
    uint8_t *rest = NULL;
    size_t n = 0;
    int status = exchange(self, during, enough, &rest, &n);
    if (status > WARNING) return status;
    int taken = take_values(self, during, values, rest, n);
    return taken == OK ? status : taken;
}

/* -- the worker ----------------------------------------------------------------------------------- */

/* Start one of the interpreters; an errno if there is none. */
static int spawn(Backend *self, int theirs, const char *folder, const char *name) {
    char program[4096], fallback[] = "python3", flags[] = "-IB", recorded[] = PYTHON;
    snprintf(program, sizeof program, "%s/hedgehop_worker", folder);
    const char *chosen = getenv("HEDGEHOP_PYTHON");
    const char *const python =
        chosen && *chosen ? chosen : access(recorded, X_OK) == 0 ? recorded : fallback;
    char *const arguments[] = {(char *)python, flags, program, (char *)name, NULL};
    const int has_error = fcntl(STDERR_FILENO, F_GETFD) >= 0;
    posix_spawn_file_actions_t actions;
    posix_spawnattr_t attributes;
    sigset_t none;
    sigemptyset(&none);
    int error = posix_spawn_file_actions_init(&actions);
    if (error) return error;
    posix_spawnattr_init(&attributes);
    posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETPGROUP | POSIX_SPAWN_SETSIGMASK);
    posix_spawnattr_setpgroup(&attributes, 0);
    posix_spawnattr_setsigmask(&attributes, &none);
    posix_spawn_file_actions_adddup2(&actions, theirs, CHANNEL);
    posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
    if (!has_error)
        posix_spawn_file_actions_addopen(&actions, STDERR_FILENO, "/dev/null", O_WRONLY, 0);
    posix_spawn_file_actions_adddup2(&actions, STDERR_FILENO, STDOUT_FILENO);
    error = posix_spawnp(&self->worker, python, &actions, &attributes, arguments, environ);
    posix_spawn_file_actions_destroy(&actions);
    posix_spawnattr_destroy(&attributes);
    if (error) {
        char message[4300];
        snprintf(message, sizeof message, "no Python interpreter, got '%s' (%s), expected one by "
                 "HEDGEHOP_PYTHON", python, strerror(error));
        self->worker = 0;
        tell(self, ERROR, message);
    }
    return error;
}

/* Hear from the worker that the component is made. */
static int greet(Backend *self) {
    struct pollfd waiting = {.fd = self->channel, .events = POLLIN};
    const char *chosen = getenv("HEDGEHOP_START_TIMEOUT_S");
    double patience_s = chosen ? atof(chosen) : 0.0;
    if (!(patience_s > 0.0 && patience_s < 1e6)) patience_s = PATIENCE_S;
    const int64_t until = milliseconds() + (int64_t)(1e3 * patience_s);
    int ready;
    do {
        int64_t left = until - milliseconds();
        ready = poll(&waiting, 1, left > 0 ? (int)left : 0);
    } while (ready < 0 && errno == EINTR);
    if (ready > 0) {
        uint8_t *rest = NULL;
        size_t n = 0;
        return receive(self, "start", &rest, &n) <= WARNING;
    }
    char message[120];
    snprintf(message, sizeof message, "the worker did not start within %g s, set "
             "HEDGEHOP_START_TIMEOUT_S for more", patience_s);
    tell(self, ERROR, message);
    kill(self->worker, SIGKILL);
    return 0;
}

Backend *backend_new(const char *name, const char *folder, LogFunction log, void *environment) {
    if (!folder) {
        log(environment, ERROR, NULL, "the master gave no resource folder, where the component is");
        return NULL;
    }
    Backend *self = calloc(1, sizeof *self);
    if (!self) return NULL;
    *self = (Backend){.channel = -1, .owner = getpid(), .log = log, .environment = environment};
    int ends[2];
    if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends) != 0) {
        tell(self, ERROR, "no socket for the worker");
        free(self);
        return NULL;
    }
    /* away from the numbers that the worker's own are made from; closed in any other child */
    const int theirs = fcntl(ends[1], F_DUPFD_CLOEXEC, 10);
    close(ends[1]);
    self->channel = ends[0];
    fcntl(self->channel, F_SETFD, FD_CLOEXEC);
#ifdef SO_NOSIGPIPE
    setsockopt(self->channel, SOL_SOCKET, SO_NOSIGPIPE, &(int){1}, sizeof(int));
#endif
    const int started = theirs >= 0 && spawn(self, theirs, folder, name) == 0;
    if (theirs >= 0) close(theirs);
    if (!started || !greet(self)) {
        backend_free(self);
        return NULL;
    }
    return self;
}

void backend_free(Backend *self) {
    if (!self) return;
    if (self->channel >= 0) close(self->channel); /* the worker reads the end and ends */
    if (self->worker > 0 && self->owner == getpid()) reap(self, FAREWELL_MS);
    free(self->buffer);
    free(self);
}

/* -- the calls ------------------------------------------------------------------------------------ */

int backend_initialize(Backend *self, Values *values, double start, double stop) {
    const double times[] = {start, stop};
    return call(self, "initialization", values, begin(self, INITIALIZE) &&
                append(self, times, sizeof times) && append_values(self, values));
}

int backend_step(Backend *self, Values *values, double t, double h) {
    const double times[] = {t, h};
    return call(self, "a step", values, begin(self, STEP) && append(self, times, sizeof times) &&
                append_values(self, values));
}

int backend_outputs(Backend *self, Values *values) {
    return call(self, "reading outputs", values, begin(self, OUTPUTS) && append_values(self, values));
}

int backend_get_state(Backend *self, uint8_t **bytes, size_t *n) {
    uint8_t *rest = NULL;
    int status = exchange(self, "saving its state", begin(self, GET_STATE), &rest, n);
    if (status > WARNING) return status;
    *bytes = malloc(*n ? *n : 1);
    if (!*bytes) return tell(self, ERROR, "out of memory");
    memcpy(*bytes, rest, *n);
    return status;
}

int backend_set_state(Backend *self, const Values *values, const uint8_t *bytes, size_t n) {
    uint8_t *rest = NULL;
    size_t size = 0;
    int enough = begin(self, SET_STATE) && append_values(self, values) && append(self, bytes, n);
    return exchange(self, "restoring its state", enough, &rest, &size);
}
