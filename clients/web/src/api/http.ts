// Requests to the server that the page came from, and why there is no answer.

/** The server answered, and it is no. */
export class Refused extends Error {
  constructor(
    readonly status: number,
    readonly code: string,
    message: string,
    readonly field: string | null = null,
  ) {
    super(message);
    this.name = 'Refused';
  }
}

/** Nobody answered. */
export class Unreachable extends Error {
  constructor(message = 'the server does not answer') {
    super(message);
    this.name = 'Unreachable';
  }
}

const KEY = 'orenx-key';
/** How long an answer may take, unless a request says otherwise. */
const PATIENCE_MS = 20_000;

export interface Ask {
  method?: 'GET' | 'POST' | 'PUT' | 'DELETE';
  /** Sent as JSON. */
  json?: unknown;
  body?: BodyInit;
  accept?: string;
  signal?: AbortSignal;
  /** 0: as long as it takes. */
  patienceMs?: number;
}

export class Api {
  private key: string | null;
  /** Called when the server asks who we are. */
  onUnauthenticated: () => void = () => undefined;

  constructor(
    private readonly base = '',
    private readonly storage: Pick<Storage, 'getItem' | 'setItem' | 'removeItem'> = sessionStorage,
  ) {
    this.key = storage.getItem(KEY);
  }

  get hasKey(): boolean {
    return this.key !== null;
  }

  /** Kept until the tab is closed. */
  setKey(key: string | null): void {
    this.key = key;
    if (key === null) this.storage.removeItem(KEY);
    else this.storage.setItem(KEY, key);
  }

  async ask(path: string, ask: Ask = {}): Promise<Response> {
    const headers = new Headers({ accept: ask.accept ?? 'application/json' });
    const { key } = this;
    if (key !== null) headers.set('authorization', `Bearer ${key}`);
    let body = ask.body ?? null;
    if (ask.json !== undefined) {
      headers.set('content-type', 'application/json');
      body = JSON.stringify(ask.json);
    } else if (body !== null) {
      headers.set('content-type', 'application/octet-stream');
    }
    const patience = ask.patienceMs ?? PATIENCE_MS;
    const signals = [ask.signal, patience > 0 ? AbortSignal.timeout(patience) : undefined];
    const signal = anyOf(signals.filter((signal) => signal !== undefined));
    let response: Response;
    try {
      response = await fetch(this.base + path, { method: ask.method ?? 'GET', headers, body, signal });
    } catch (error) {
      if (ask.signal?.aborted) throw error;
      throw new Unreachable();
    }
    if (response.ok) return response;
    const refused = await refusal(response);
    // What was asked with the last key says nothing of this one.
    if (refused.status === 401 && key === this.key) this.onUnauthenticated();
    throw refused;
  }

  async json<T>(path: string, ask: Ask = {}): Promise<T> {
    const response = await this.ask(path, ask);
    return (await response.json()) as T;
  }

  async bytes(path: string, ask: Ask = {}): Promise<ArrayBuffer> {
    const response = await this.ask(path, { accept: 'application/octet-stream', ...ask });
    return response.arrayBuffer();
  }
}

/** AbortSignal.any, which browsers of 2023 lack. */
function anyOf(signals: AbortSignal[]): AbortSignal {
  const all = new AbortController();
  for (const signal of signals) {
    if (signal.aborted) all.abort(signal.reason);
    else signal.addEventListener('abort', () => all.abort(signal.reason), { once: true });
  }
  return all.signal;
}

async function refusal(response: Response): Promise<Refused> {
  const text = await response.text().catch(() => '');
  try {
    const { error } = JSON.parse(text) as { error: { code: string; message: string; field?: string } };
    return new Refused(response.status, error.code, error.message, error.field ?? null);
  } catch {
    return new Refused(response.status, 'HTTP', `the server answers ${response.status}`);
  }
}

/** A map's path; ids are checked by the server, and escaped here. */
export function mapPath(mapId: string, rest = ''): string {
  return `/v1/maps/${encodeURIComponent(mapId)}${rest}`;
}

/** What to show of an error, in a sentence. */
export function said(error: unknown): string {
  const text = error instanceof Error ? error.message : String(error);
  return text.charAt(0).toUpperCase() + text.slice(1);
}
