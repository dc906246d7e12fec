// Exact images, one request per image: the last one asked for wins, neighbours are fetched while nothing else is to do.

const MOST_IN_FLIGHT = 2;
const MOST_KEPT = 10;

export class Images {
  private readonly kept = new Map<number, ImageBitmap>();
  private readonly flights = new Map<number, AbortController>();
  private wanted = -1;
  private failed = false;

  constructor(
    private readonly url: (image: number) => string,
    private readonly count: number,
    private readonly paint: (bitmap: ImageBitmap, image: number) => void,
    private readonly onError: () => void,
  ) {}

  want(image: number): void {
    this.wanted = image;
    const bitmap = this.kept.get(image);
    if (bitmap) {
      this.paint(bitmap, image);
      this.prefetch();
    } else this.fetch(image);
  }

  private fetch(image: number): void {
    if (this.flights.has(image) || this.failed) return;
    while (this.flights.size >= MOST_IN_FLIGHT) {
      const [oldest, control] = this.flights.entries().next().value!;
      this.flights.delete(oldest);
      control.abort();
    }
    const control = new AbortController();
    this.flights.set(image, control);
    this.load(image, control.signal)
      .catch((error: unknown) => {
        if (error instanceof DOMException && error.name === "AbortError") return;
        if (image !== this.wanted) return;
        this.failed = true;
        this.onError();
      })
      .finally(() => {
        if (this.flights.get(image) === control) this.flights.delete(image);
        if (!this.kept.has(this.wanted)) this.fetch(this.wanted);
        else this.prefetch();
      });
  }

  private async load(image: number, signal: AbortSignal): Promise<void> {
    const response = await fetch(this.url(image), { signal });
    if (!response.ok) throw new Error(`image ${image}: ${response.status}`);
    const bitmap = await createImageBitmap(await response.blob());
    this.kept.set(image, bitmap);
    if (this.kept.size > MOST_KEPT) {
      const [oldest] = this.kept.keys();
      this.kept.get(oldest!)?.close();
      this.kept.delete(oldest!);
    }
    if (image === this.wanted) this.paint(bitmap, image);
  }

  private prefetch(): void {
    if (this.flights.size) return;
    for (const neighbour of [this.wanted + 1, this.wanted + 2, this.wanted - 1])
      if (neighbour >= 0 && neighbour < this.count && !this.kept.has(neighbour)) {
        this.fetch(neighbour);
        return;
      }
  }

  close(): void {
    for (const control of this.flights.values()) control.abort();
    this.flights.clear();
    for (const bitmap of this.kept.values()) bitmap.close();
    this.kept.clear();
    this.failed = true;
  }
}
